"""Peeling on a table: forces of the floor, and limits on how the chain stands on it."""
