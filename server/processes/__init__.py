"""Computing processes: their start, limits, sandbox and tasks."""
