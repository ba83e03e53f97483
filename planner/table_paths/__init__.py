"""Paths for a table: orders of cells in which a chain can fold while the floor supports it."""
