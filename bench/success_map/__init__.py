"""The success map: success rates of folds by method and kind of path, and by seed."""
