"""Planner: names of array types, errors and progress, which all its components share."""
