"""Explosion: the folded chain is let go until it is straight, in one of several ways."""
