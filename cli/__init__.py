"""Commands of ``foldback`` that need no service: they read files, fold, and write files.

The program itself, with the parser of all commands, is in ``server.cli``.
"""
