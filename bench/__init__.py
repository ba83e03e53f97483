"""Benchmarks that anyone can rerun: ``make bench`` prints figures and writes ``out/bench.json``."""
