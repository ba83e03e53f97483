"""Shapes and solids: cells, meshes, and cells that stand for a mesh."""
