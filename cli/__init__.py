"""Commands of ``foldback`` that need no service: they read files, fold, and write files."""
