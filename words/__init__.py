"""Texts for people: figures, verdicts, choices and settings in English."""
