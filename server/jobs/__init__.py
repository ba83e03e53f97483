"""Jobs: the queue, the worker that computes folds and movies, and the cleanup."""
