"""Support: in how many of the frames that should show a structure it was measured."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from savmap.geometry import pinhole
from savmap.types import Bools, Floats, RowFacts, Structure, Track, Trajectory, ViewSpec

MARGIN = 0.06
REACH_QUANTILE = 0.8


@dataclass(frozen=True)
class Support:
    """How many frames should have shown a structure, and how many of these did."""

    expected: int
    seen: int

    @property
    def share(self) -> float:
        """0..1; 1 where no frame should have shown it."""
        return min(self.seen / self.expected, 1.0) if self.expected else 1.0


def supports(
    structures: Sequence[Structure], tracks: Sequence[Track], path: Trajectory, facts: RowFacts
) -> dict[str, Support]:
    """The support of a plugin's structures by their ids, from its tracks.

    A frame should show a structure where its middle is well within a view of the plugin, from no further away than
    most frames that measured one of its label. A track is of the structure whose id its name begins with."""
    views = {name: _rendered(name, path, facts) for name in {name for track in tracks for name in track.views}}
    seen = {structure.id: _frames_of(structure, tracks, path) for structure in structures}
    away = {structure.id: _distances(structure, path) for structure in structures}
    supported: dict[str, Support] = {}
    for label in {structure.label for structure in structures}:
        alike = [structure for structure in structures if structure.label == label]
        distances = np.concatenate([away[structure.id][seen[structure.id]] for structure in alike])
        reach = float(np.quantile(distances, REACH_QUANTILE)) if len(distances) else 0.0
        for structure in alike:
            shown = np.zeros(len(path.frames), np.bool_)
            for name, rendered in views.items():
                shown |= rendered & _shows(facts.views[name], structure, path)
            expected = shown & (away[structure.id] <= reach)
            supported[structure.id] = Support(int(expected.sum()), int((expected & seen[structure.id]).sum()))
    return supported


def _rendered(view: str, path: Trajectory, facts: RowFacts) -> Bools:
    """From which frames of the path (n,) a view was rendered: every so many of its own pass."""
    spec, passes = facts.views[view], facts.frames.passes
    return np.array(
        [view.startswith(f"{passes[frame]} / ") and spec.shows(frame) for frame in path.frames.tolist()], np.bool_
    )


def _frames_of(structure: Structure, tracks: Sequence[Track], path: Trajectory) -> Bools:
    """Which frames of the path (n,) measured a structure."""
    frames = [track.frames for track in tracks if is_of(track.name, structure.id)]
    return np.isin(path.frames, np.concatenate([np.zeros(0, np.int64), *frames]))


def is_of(track: str, structure: str) -> bool:
    """Whether a track or landmark belongs to a structure, by their names."""
    return track == structure or track.startswith(f"{structure} / ")


def _distances(structure: Structure, path: Trajectory) -> Floats:
    """From the camera to the middle, m (n,)."""
    return np.asarray(np.linalg.norm(path.world_from_rig[:, :3, 3] - structure.vertices.mean(axis=0), axis=1))


def _shows(view: ViewSpec, structure: Structure, path: Trajectory) -> Bools:
    """Which frames' (n,) view has a structure's middle well within it."""
    offsets = structure.vertices.mean(axis=0) - path.world_from_rig[:, :3, 3]
    points = np.einsum("ni,nij->nj", offsets, path.world_from_rig[:, :3, :3] @ view.rig_from_view)
    pixels = pinhole.project(points, view.camera)
    size = np.array([view.width, view.height])
    within = ((pixels > MARGIN * size) & (pixels < (1 - MARGIN) * size)).all(axis=1)
    return np.asarray(within & (points[:, 2] > 0))
