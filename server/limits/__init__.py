"""How much of everything there may be: quotas, and one making of a thing for all who want it."""
