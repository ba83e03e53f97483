"""Files that are computed from folds and uploads: previews, exports, trajectories."""
