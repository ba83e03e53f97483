"""Sweeps: specs of benchmarks; processor time besides folds, faults, and very large sweeps."""
