"""Scenes: their files, the plugins' structures in them, the building, the goods."""
