"""What a service does for those who wait: the time that it says is left, and movies."""
