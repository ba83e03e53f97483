"""Checks of ``foldback doctor``: each looks at one thing that the service needs."""
