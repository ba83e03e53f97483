"""Clearance: exact distances between modules, at one time and over a whole motion."""
