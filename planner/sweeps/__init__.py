"""Sweeps: many folds on this machine or a cluster, as one table."""
