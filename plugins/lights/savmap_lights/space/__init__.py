"""Lamps in space, from a known path: the plane and line they are on, their places, and what they have in common."""
