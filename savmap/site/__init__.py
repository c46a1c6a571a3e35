"""The site file: its model, loading, overrides, layout, and what can be known to be wrong before a run."""
