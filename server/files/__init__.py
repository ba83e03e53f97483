"""Files that are made of folds and uploads: previews, exports, trajectories."""
