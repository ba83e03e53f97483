"""Web: turns timelines into scenes and pages."""
