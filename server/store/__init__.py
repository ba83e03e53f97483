"""The store: tables, the rows of folds, where their files are, and which workers live."""
