"""Trajectories: plans with time stamps that real robots can keep, and their motor torques."""
