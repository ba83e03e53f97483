"""Benchmarks of folds on a table: statics, paths, explosions."""
