"""Simulation: chains as MuJoCo models, and the numbers that govern them."""
