"""Clearance: how far apart modules stay, exactly, at one moment and over a whole motion."""
