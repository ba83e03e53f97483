"""Turns: a fold as a sequence of turns of single hinges, merged into steps where that is clear."""
