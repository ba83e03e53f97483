"""Seeded faults: deliberate mistakes, which the suite must find."""
