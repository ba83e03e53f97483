"""Constants: how many there are, and which of them change results."""
