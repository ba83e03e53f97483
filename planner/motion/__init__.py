"""Motion: joint angles over time, of all hinges or a moving window, and a timeline on disk."""
