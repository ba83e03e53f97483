"""Simulation: chains as MuJoCo models, and their parameters."""
