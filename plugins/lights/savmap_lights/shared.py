"""Lamps that another row sees too: those over the aisle between two faces, by their centres."""

from collections.abc import Sequence

import numpy as np

from savmap.types import CrossRowLandmark, Structure


def shared(structures: Sequence[Structure]) -> list[CrossRowLandmark]:
    """Every lamp's centre; its vertices' errors are taken for common to all of them."""
    return [
        CrossRowLandmark(own.id, own.label, own.vertices.mean(axis=0), np.asarray(own.covariances.mean(axis=0)))
        for own in structures
        if own.label == "light"
    ]
