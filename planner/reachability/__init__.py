"""Reachability: whether turns lead to a figure, and at which size of the modules, with a proof."""
