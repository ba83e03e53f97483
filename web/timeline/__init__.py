"""What a browser is told of a timeline: stretches of frames, figures, and views that are shared."""
