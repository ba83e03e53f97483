"""Clearance: lower bounds of distances between modules, at one moment or over a whole motion."""
