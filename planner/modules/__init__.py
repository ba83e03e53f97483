"""Modules that foldback ships, as ``foldback-module/1`` files."""
