"""Shapes and solids: cells, meshes, and the voxels of a mesh."""
