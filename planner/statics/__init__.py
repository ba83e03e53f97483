"""Statics on a floor: what a chain that stands on it asks of its hinges, at the least."""
