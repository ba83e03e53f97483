"""Storage: names of files, whole writes, checked array files, and directories of output."""
