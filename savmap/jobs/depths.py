"""Depths behind a row's face, of what a run kept of its pictures."""

from pathlib import Path

import numpy as np

from savmap.errors import OutputError
from savmap.files.serialization import unpacked
from savmap.jobs.cache import FolderCache
from savmap.jobs.scheduler import STRIPS
from savmap.maps.orthophoto_file import read_orthophotos
from savmap.types import FaceDepths, PlanePatch, RowMap, RowStrips
from savmap.vision.face_depths import face_depths


def kept_depths(folder: Path, row: RowMap) -> FaceDepths | None:
    """The depths of a row by the strips and the orthophoto that a run kept in its folder; None where it kept none, or
    they are not of this row."""
    content = FolderCache(folder).load(row.name, STRIPS, None)
    try:
        photo = read_orthophotos([row.name], folder).get(row.name)
        strips = None if content is None else unpacked(content, RowStrips)
    except (OutputError, ValueError):
        return None
    if photo is None or strips is None:
        return None
    size = photo.pixel_m * np.array([photo.width, photo.height])
    return face_depths(
        PlanePatch("face", photo.origin, photo.right, photo.up, size, photo.pixel_m), strips, row.trajectory
    )
