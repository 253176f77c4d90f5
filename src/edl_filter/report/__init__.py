"""Figures and pages from a run's results."""
