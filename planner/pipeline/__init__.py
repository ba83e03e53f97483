"""From an input to a plan: stages, attempts, and what is written on the way."""
