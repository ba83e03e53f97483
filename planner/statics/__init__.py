"""Statics on a floor: the smallest hinge torques of a chain that stands on it."""
