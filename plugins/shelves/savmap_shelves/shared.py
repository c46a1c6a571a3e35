"""Uprights that another row sees too: a rack's two faces stand on the same frames, which cross it from front to back."""

from collections.abc import Sequence

import numpy as np

from savmap.types import CrossRowLandmark, Structure

DEEPEST_RACK_M = 1.6
FRAME_SIGMA_M = 0.005


def shared(structures: Sequence[Structure]) -> list[CrossRowLandmark]:
    """Every upright's centre line, along x: a frame's two uprights are at one x to `FRAME_SIGMA_M`. Its edges' errors are taken for
    common to both."""
    return [
        CrossRowLandmark(
            own.id,
            own.label,
            own.vertices.mean(axis=0),
            own.covariances.mean(axis=0) + FRAME_SIGMA_M**2 * np.diag([1.0, 0.0, 0.0]),
            axes=("x",),
            behind_m=DEEPEST_RACK_M,
        )
        for own in structures
        if own.label == "upright"
    ]
