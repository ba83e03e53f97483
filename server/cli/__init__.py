"""Commands of ``foldback`` that need the service, and the entry point of all commands."""
