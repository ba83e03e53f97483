"""Plans: a chain, its motion and its certificate, in files that others can read and replay."""
