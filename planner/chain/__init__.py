"""Chains of modules: geometry, kinematics, dynamics, and the paths that define them."""
