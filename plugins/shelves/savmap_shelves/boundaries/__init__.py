"""From the masks of one view to labelled edges and corners."""

from savmap_shelves.boundaries.features import extract_features

__all__ = ["extract_features"]
