"""Scores as values: of a run against the truth, of several methods, and of a sensor model that is calibrated."""
