"""Chains of modules: their geometry, kinematics and dynamics, and the paths they come from."""
