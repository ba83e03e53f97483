"""Planner: names of array types, errors, progress and processor cores, for all its components."""
