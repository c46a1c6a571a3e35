"""A pass's map in the frame of the row that it shows."""

from dataclasses import replace

import numpy as np

from savmap.apps.dates.comparison.records import RowMotion
from savmap.types import Floats, RowMap, RowPlace, Structure, Trajectory, Verdict


def in_row(row: RowMap, place: RowPlace, mapped: RowMap) -> RowMap:
    """A pass that was solved in metres, moved along x into the mapped row's frame, with that row's name: by the median
    distance of what is in both."""
    here, other = ({(p, s.id): s for p, group in of.structures.items() for s in group} for of in (row, mapped))
    off = [
        _middle_x(other[plugin, theirs]) - _middle_x(here[plugin, ours])
        for plugin, ours, theirs in place.pairs
        if (plugin, ours) in here
    ]
    return moved(replace(row, name=place.row), np.eye(3), np.array([float(np.median(off)), 0.0, 0.0]))


def _middle_x(structure: Structure) -> float:
    return float((structure.vertices[:, 0].min() + structure.vertices[:, 0].max()) / 2)


def laid_onto(row: RowMap, motion: RowMotion) -> RowMap:
    """A pass laid onto the mapped row by what a comparison says of how that row's frame lies in the pass's, of which
    little is left: millimetres, and tenths of a percent."""
    origin, *axes = motion.points(np.vstack([np.zeros(3), np.eye(3)]))
    row_from_mapped = np.array(axes).T - origin[:, None]
    linear = np.linalg.inv(row_from_mapped)
    return moved(row, linear, -linear @ origin)


def moved(row: RowMap, linear: Floats, shift_m: Floats) -> RowMap:
    """A row whose points p are at linear (3, 3) p + shift (3,) m. The linear part is nearly the identity: covariances
    and the camera's attitudes stay."""
    poses = row.trajectory.world_from_rig.copy()
    poses[:, :3, 3] = poses[:, :3, 3] @ linear.T + shift_m
    face = row.face
    return replace(
        row,
        trajectory=Trajectory(row.trajectory.frames, poses, row.trajectory.sigma_m),
        structures={
            name: tuple(_moved(part, linear, shift_m) for part in group) for name, group in row.structures.items()
        },
        face=None if face is None else replace(face, origin=linear @ face.origin + shift_m),
        verdict=None if row.verdict is None else _shifted(row.verdict, shift_m),
    )


def _moved(structure: Structure, linear: Floats, shift_m: Floats) -> Structure:
    solid = structure.solid
    return replace(
        structure,
        vertices=structure.vertices @ linear.T + shift_m,
        solid=None if solid is None else replace(solid, outline=solid.outline @ linear.T + shift_m),
    )


def _shifted(verdict: Verdict, shift_m: Floats) -> Verdict:
    """A verdict whose warnings are about other places."""
    warnings = []
    for warning in verdict.warnings:
        if warning.place is not None:
            x, y, z = (shift_m + np.array(warning.place)).tolist()
            warning = replace(warning, place=(x, y, z))
        warnings.append(warning)
    return replace(verdict, warnings=tuple(warnings))
