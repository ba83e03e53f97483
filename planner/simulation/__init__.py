"""Simulation: dynamics of chains by articulated bodies and by MuJoCo, and of robots."""
