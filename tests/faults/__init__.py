"""Seeded faults: mistakes made on purpose, which the suite must find."""
