"""Pages: one file for each, and their texts about folds."""
