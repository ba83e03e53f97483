"""Benchmarks of clearance: the planner's sweeps, the independent checker, forged plans."""
