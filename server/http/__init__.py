"""Processing of every request: addresses, headers, limits, uploads, errors."""
