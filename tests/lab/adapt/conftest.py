from collections.abc import Sequence

import numpy as np
import pytest

from savmap.lab.adapt.faces import Outline, faces_of, outlines_of
from savmap.lab.adapt.masks import KnownFace
from savmap.types import PlaneEvidence

from .filmed_wall import BOXES, CLASSES, quad


@pytest.fixture
def outlines() -> Sequence[Outline]:
    return outlines_of([quad(name) for name in BOXES], CLASSES)


@pytest.fixture
def known(outlines: Sequence[Outline]) -> KnownFace:
    """The wall with evidence of 0.8 within all outlines."""
    (face,) = faces_of(outlines)
    mean = np.zeros((2, *face.patch.shape), np.float32)
    for outline in outlines:
        mean[CLASSES.index(outline.label)][face.inside(outline)] = 0.8
    grey = np.full((*face.patch.shape, 3), 120, np.uint8)
    ones = np.ones(face.patch.shape, np.float32)
    return KnownFace.of(face, PlaneEvidence(face.patch, CLASSES, mean, ones, grey, ones))
