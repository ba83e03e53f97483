"""Storage: names of files, whole writes, checked zarr groups, and directories of output."""
