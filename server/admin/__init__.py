"""Tasks of operators: folds, backups, restoration and the migration of the database."""
