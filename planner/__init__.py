"""Planner: chains, explosion, playback, certificates, plans; ``foldback`` holds what is public."""
