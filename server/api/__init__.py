"""The API: a file for each resource, and what they share."""
