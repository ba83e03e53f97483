"""Peeling: modules leave a folded chain from its ends, in a window that moves along it."""
