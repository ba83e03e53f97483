"""Motion: what a chain does over time, as frames, windows and a timeline on disk."""
