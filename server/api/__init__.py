"""The API: one file of routes for each resource."""
