"""Load and faults: what the service holds, and what it survives."""
