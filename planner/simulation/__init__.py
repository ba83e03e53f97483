"""Simulation: the dynamics of chains, with articulated bodies or with MuJoCo, and of robots."""
