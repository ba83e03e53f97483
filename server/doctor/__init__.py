"""What ``foldback doctor`` looks at, a file for each thing that the service needs."""
