"""Motion: the joint angles of all hinges, or of a moving window, over time; timelines on disk."""
