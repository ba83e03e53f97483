"""The store: tables, rows of folds, places of their files, and live workers."""
