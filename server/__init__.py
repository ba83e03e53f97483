"""HTTP, jobs, storage, settings and the command line."""
