"""Sweeps: processor time besides the folds, faults, and large sweeps."""
