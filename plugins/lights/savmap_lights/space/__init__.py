"""Lamps in space, by a known camera path: their plane and line, their places, and relations between them."""
