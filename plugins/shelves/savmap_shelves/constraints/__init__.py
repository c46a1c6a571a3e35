"""The rack's part of the factor graph: the grid of tracks, its relations, and what each observation is worth."""

from savmap_shelves.constraints.constrain import GridSettings, constrain, grid_settings

__all__ = ["GridSettings", "constrain", "grid_settings"]
