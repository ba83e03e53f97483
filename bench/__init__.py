"""Figures that anyone can make: ``make bench`` prints tables and writes ``out/bench.json``."""
