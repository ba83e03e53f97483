"""Certificates: verification of a motion, independent of the simulation that computed it."""
