"""Silhouettes: words and pictures, and the cells that they become."""
