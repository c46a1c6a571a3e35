"""Ceilings with lamps, painted: several a second, exact masks."""
