"""Compilation of kernels: numba's cache, what may compile, progress, and processor cores."""
