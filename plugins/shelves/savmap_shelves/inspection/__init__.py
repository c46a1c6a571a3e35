"""Inspection of racks: limits with their sources, which loads fit, and deviations from a drawing."""
