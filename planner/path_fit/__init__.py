"""Path fit: cells of a lattice that are chosen together with the path through them, for a solid."""
