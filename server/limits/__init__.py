"""Limits: quotas, fair shares, and one shared computation for equal requests."""
