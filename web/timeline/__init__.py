"""Timelines for browsers: ranges of frames, figures, and shared readers."""
