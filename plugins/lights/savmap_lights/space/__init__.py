"""Lamps in space, by a known camera path: where the rays to them meet, and relations between them."""
