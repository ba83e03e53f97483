"""Seeded faults: deliberate mistakes that the test suite must find."""
