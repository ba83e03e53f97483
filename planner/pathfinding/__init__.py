"""Paths through shapes: an order in which a chain can visit every cell once."""
