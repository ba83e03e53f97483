"""Web: scenes and pages from timelines."""
