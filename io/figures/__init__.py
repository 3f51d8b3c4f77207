"""Figures of runs, evaluations, comparisons and calibrations, and the live window."""
