"""Pillars, as a plugin of savmap."""
