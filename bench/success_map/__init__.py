"""The success map: which paths fold by which method, and which meshes by which seed."""
