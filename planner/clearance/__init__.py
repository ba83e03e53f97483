"""Clearance: lower bounds of distances between modules, at one time and over a whole motion."""
