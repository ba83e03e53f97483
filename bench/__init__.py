"""Benchmarks that anyone can rerun: ``make bench`` prints tables and writes ``out/bench.json``."""
