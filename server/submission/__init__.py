"""Submissions: sources of folds, checks of requests, and their entry into the queue."""
