"""The paper's own experiments, run again: ``make reproduction``."""
