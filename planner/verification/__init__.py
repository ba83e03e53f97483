"""Verification: an independent check of a plan, based only on its files."""
