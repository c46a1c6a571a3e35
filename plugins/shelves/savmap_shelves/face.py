"""The grid of uprights and beam levels with the camera's path, all on the face plane: from features to a labelled fit."""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np

from savmap.errors import StructureError
from savmap.types import Feature, Floats, Ints, RowFacts
from savmap_shelves.adjust import Fit, Sighted, adjusted
from savmap_shelves.floor import Feet, feet_of
from savmap_shelves.levels import Levels, find_levels
from savmap_shelves.odometry import glances, typical_spacing
from savmap_shelves.passes import Shape, laid_on, moved
from savmap_shelves.path import along_uprights, filled, odometry, sighted_at, upright_edges
from savmap_shelves.rectify import facing, rectified
from savmap_shelves.sightings import Catalogue, Tangents, catalogue, tangents
from savmap_shelves.uprights import Uprights, find_uprights

STATE_PRIOR = np.array([0.05, 0.15, 0.08, 0.01, 0.01, 0.01])


@dataclass(frozen=True)
class Settings:
    """Least support of an upright, and of a level, as a share of the usual one; `gate`: an observation farther than this
    many standard deviations from the fitted grid is dropped; least_frames: fewer are refused."""

    upright_support: float = 0.25
    level_support: float = 0.3
    gate: float = 4.0
    least_frames: int = 3


@dataclass(frozen=True)
class Grid:
    """What was found: uprights, levels, and the fit of both (states (n, 6) as in adjust.py; edges: x of uprights' left and
    right edges, then y of levels' lower and upper edges) over `observations`; `source`: each one's row in Pixels."""

    seen: Catalogue
    face: Tangents
    world_from_rig: Floats
    uprights: Uprights
    levels: Levels
    fit: Fit
    observations: Sighted
    source: Ints
    feet: Feet


def observed_edges(seen: Catalogue, face: Tangents, uprights: Uprights, levels: Levels) -> tuple[Sighted, Ints]:
    """All sightings of the found uprights' edges (both ends) and beams' corners, and each one's row in Pixels."""
    vertical, posts = upright_edges(seen, face, uprights)
    beams = np.flatnonzero(levels.which >= 0)
    level = 2 * (len(uprights.x) + levels.which[beams])[:, None, None] + np.arange(2) + np.zeros((2, 1), dtype=np.int64)
    usable = (seen.corners[beams] >= 0) & levels.ends[beams][:, :, None]
    horizontal, corners = sighted_at(seen, face, seen.corners[beams][usable], level[usable], 1)
    both = (np.concatenate([getattr(part, f.name) for part in (vertical, horizontal)]) for f in fields(Sighted))
    return Sighted(*both), np.concatenate([posts, corners])


def fit_grid(features: Sequence[Feature], facts: RowFacts, settings: Settings, attitudes: Floats | None = None) -> Grid:
    """Find the grid in the features of all frames. attitudes (n, 3, 3): world_from_rig as far as known (see `rectified`).

    Raises StructureError where there are too few frames, too little motion, or no uprights or beams.
    """
    seen = catalogue(features, facts)
    _require_sightings(seen, facts, settings)
    world_from_rig = _attitudes(seen, facts, attitudes)
    across = np.zeros(len(seen.points.frame), dtype=np.bool_)
    across[seen.edges.ravel()] = True
    face = tangents(seen.points, seen.views, world_from_rig, across)
    passes = [frames for name in dict.fromkeys(facts.frames.passes) if len(frames := facts.frames.of_pass(name))]
    states = np.tile([1.0, 0, 0, 0, 0, 0], (len(facts.frames), 1))
    spacing = typical_spacing(seen, face)
    if not np.isfinite(spacing):
        raise StructureError(f"row {facts.name}: no picture shows two uprights; widen the view or check its direction")
    views = glances(seen, face, len(facts.frames))
    sizes = (0.06 * spacing, 0.18 * spacing, settings.upright_support)
    for frames in passes:
        way = odometry(views, facts, frames, spacing)
        states[frames] = along_uprights(seen, face, world_from_rig, views, way, sizes)
    feet = feet_of(features, seen, world_from_rig)
    fitter = Fitter(seen, face, world_from_rig, settings, spacing, feet)
    if len(passes) > 1:
        states = _joined([fitter.grid(states, frames, facts.name) for frames in passes], passes, facts.name)
    return fitter.grid(states, np.arange(len(facts.frames)), facts.name)


def _require_sightings(seen: Catalogue, facts: RowFacts, settings: Settings) -> None:
    shown = np.unique(seen.upright_frame)
    if not len(shown):
        raise StructureError(
            f"row {facts.name}: no upright was found in any of {len(facts.frames)} frames; check the view's direction"
        )
    if not len(seen.corners):
        raise StructureError(
            f"row {facts.name}: no beam that meets an upright was found in any of {len(facts.frames)} frames"
        )
    if len(shown) < settings.least_frames:
        raise StructureError(
            f"row {facts.name}: uprights were found in {len(shown)} frames only, {settings.least_frames} are needed"
        )


def _attitudes(seen: Catalogue, facts: RowFacts, attitudes: Floats | None) -> Floats:
    begins = np.array(
        [a != b for a, b in zip(facts.frames.passes[:-1], facts.frames.passes[1:], strict=True)], dtype=np.bool_
    )
    tie = np.where(begins, np.inf, np.radians(1.0 if attitudes is not None else 2.0))
    if attitudes is not None:
        return rectified(seen, attitudes, tie, np.radians(3.0))
    main = int(np.bincount(seen.upright_view, minlength=len(seen.views)).argmax())
    return rectified(seen, np.tile(facing(seen.views[main]), (len(facts.frames), 1, 1)), tie, np.radians(20.0))


def _joined(grids: Sequence[Grid], passes: Sequence[Ints], row: str) -> Floats:
    """States of all passes in the frame of the one that saw most."""
    shapes = [Shape(g.uprights.x.mean(axis=1), g.levels.section, g.levels.y.mean(axis=1)) for g in grids]
    main = int(np.argmax([len(shape.y) for shape in shapes]))
    states = grids[main].fit.states.copy()
    for index, (grid, frames) in enumerate(zip(grids, passes, strict=True)):
        if index != main:
            similarity = laid_on(shapes[main], shapes[index])
            if similarity is None:
                raise StructureError(
                    f"row {row}: passes {index + 1} and {main + 1} do not show enough of the same sections"
                )
            states[frames] = moved(grid.fit.states[frames], similarity)
    return states


@dataclass(frozen=True)
class Fitter:
    """Finds uprights and levels and fits the grid, in turns that sharpen each other."""

    seen: Catalogue
    face: Tangents
    world_from_rig: Floats
    settings: Settings
    spacing: float
    feet: Feet

    def grid(self, states: Floats, frames: Ints, row: str) -> Grid:
        """The grid that `frames` show, from a rough path `states` (n, 6)."""
        for width, height in ((0.06, 0.6), (0.04, 0.4), (0.03, 0.35)):
            uprights, levels = self._found(states, frames, (width, height), row)
            sighted, source = observed_edges(self.seen, self.face, uprights, levels)
            start = np.concatenate([uprights.x.ravel(), levels.y.ravel()])
            fit = adjusted(states, start, sighted, STATE_PRIOR, rounds=4)
            states = filled(states, fit.states, sighted, frames, 6)
        fitted = fit.edges[: 2 * len(uprights.x)].reshape(-1, 2)
        placed = replace(uprights, x=fitted)
        return Grid(self.seen, self.face, self.world_from_rig, placed, levels, fit, sighted, source, self.feet)

    def _found(self, states: Floats, frames: Ints, sizes: tuple[float, float], row: str) -> tuple[Uprights, Levels]:
        width, height = sizes
        limits = (width * self.spacing, 3 * width * self.spacing, self.settings.upright_support)
        uprights = find_uprights(self.seen, self.face, states, self.world_from_rig, frames, limits)
        if len(uprights.x) < 2:
            raise StructureError(
                f"row {row}: {len(uprights.x)} upright found; a section needs two, so the row is seen only in part"
            )
        kernel = (height, self.settings.level_support)
        floor = self.feet.floor(states, uprights.x)
        levels = find_levels(self.seen, self.face, states, self.world_from_rig, uprights, frames, kernel, floor)
        if not len(levels.section):
            raise StructureError(f"row {row}: {len(uprights.x)} uprights but no beam between them were found")
        return uprights, levels
