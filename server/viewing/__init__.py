"""Viewing: folds found by their address, their progress, and waits for their next frames."""
