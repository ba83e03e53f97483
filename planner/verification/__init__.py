"""Verification: a second look at a plan, from its files alone and apart from what made them."""
