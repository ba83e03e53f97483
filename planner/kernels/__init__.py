"""Compiled inner loops. Everything here takes and gives plain arrays."""
