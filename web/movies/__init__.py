"""Movies: options and limits, pictures, and encoding."""
