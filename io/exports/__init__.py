"""Runs and shapes in the formats of other programs."""
