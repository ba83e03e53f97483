"""Parameters: every number that a fold depends on, each defined once with its description."""
