"""Measurements of savmap: accuracy, verdicts, time and robustness, each behind `python -m bench NAME`."""
