"""Pages: a file for each, and what they say about folds in words."""
