"""Golden digests: results of small folds, compared bit by bit with stored ones."""
