"""Dependencies of routes: the fold, the owner and the body of a request, and its problems."""
