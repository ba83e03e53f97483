"""Readers: from the bytes of a file to a path, a chain, a shape, a solid, a word or a picture."""

from foldback.planner.readers.formats import Content, read

__all__ = ["Content", "read"]
