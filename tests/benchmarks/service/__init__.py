"""What a service does for visitors: the time that it says is left, movies, weights of pages."""
