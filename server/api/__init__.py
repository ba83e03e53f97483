"""The API: one file for each resource, and shared code."""
