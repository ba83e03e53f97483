"""Movies: what one may be, its pictures, and their encoding."""
