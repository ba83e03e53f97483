"""Motion: joint angles over time, as frames, windows and a timeline on disk."""
