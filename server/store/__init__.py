"""The store: tables, rows of folds, locations of their files, and live workers."""
