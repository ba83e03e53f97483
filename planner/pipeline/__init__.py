"""Pipeline from an input to a plan: stages, attempts, and their files."""
