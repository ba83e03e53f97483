"""Statics on a floor: the smallest hinge torques with which a chain can stand on it."""
