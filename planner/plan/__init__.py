"""Plans: a chain, its motion and its certificate, in files that other programs can read."""
