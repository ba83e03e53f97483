"""Readers: from the bytes of a file to a path, a chain, a shape or a solid."""

from foldback.planner.readers.formats import read

__all__ = ["read"]
