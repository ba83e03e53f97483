"""The loop of all strategies: steps, forces, snapshots, restarts and the end of a run."""
