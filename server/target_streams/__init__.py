"""Target streams: joint targets in real time, their messages, clock and limits."""
