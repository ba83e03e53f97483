"""Checks of ``foldback doctor``: one file for each requirement of the service."""
