"""Explosion: strategies that unfold a folded chain until it is straight."""
