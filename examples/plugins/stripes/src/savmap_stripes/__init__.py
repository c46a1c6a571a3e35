"""Painted stripes on the floor, as a plugin of savmap."""
