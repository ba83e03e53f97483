"""Processes that compute: how they are started, limited, confined, and what each does."""
