"""Benchmarks of the service: estimated remaining time, movies, sizes of pages."""
