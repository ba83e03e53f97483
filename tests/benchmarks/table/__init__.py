"""What folds on a table: statics, paths, explosions."""
