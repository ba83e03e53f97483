"""Jobs: the queue, the worker that takes folds and movies from it, and what tidies up."""
