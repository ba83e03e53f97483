"""Motion: joint angles over time, dense or windowed, and a timeline on disk."""
