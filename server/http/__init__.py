"""What every request goes through: addresses, headers, bounds, uploads, problems."""
