"""The store: schema, rows of folds, locations of their files, and live workers."""
