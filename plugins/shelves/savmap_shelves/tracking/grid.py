"""The grid of uprights and beam levels with the camera's path, all on the face plane: from features to a labelled fit."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from savmap.errors import StructureError
from savmap.types import Bools, Feature, Floats, Ints, RowFacts
from savmap_shelves.evidence.hidden_edges import hidden_edges
from savmap_shelves.evidence.second_readings import accepted_readings
from savmap_shelves.tracking.adjust import EdgeObservations, GridFit, adjusted
from savmap_shelves.tracking.attitudes import facing, rectified
from savmap_shelves.tracking.feet import Feet, feet_of
from savmap_shelves.tracking.levels import Levels, edges_of, expected_levels, find_levels, heights_of, seen_through
from savmap_shelves.tracking.odometry import frame_observations
from savmap_shelves.tracking.passes import PassGrid, laid_on, transformed
from savmap_shelves.tracking.path import along_uprights, edge_observations, filled, pass_odometry, upright_edges
from savmap_shelves.tracking.sightings import FaceSightings, Sightings, collect_sightings, on_face
from savmap_shelves.tracking.uprights import Uprights, find_uprights

STATE_PRIOR = np.array([0.05, 0.15, 0.08, 0.01, 0.01, 0.01])


@dataclass(frozen=True)
class TrackingSettings:
    """Least support of an upright, and of a level, as a share of the usual one; `gate`: an observation farther than this
    many standard deviations from the fitted grid is dropped; least_frames: fewer are refused."""

    upright_support: float = 0.25
    level_support: float = 0.3
    gate: float = 4.0
    least_frames: int = 3


@dataclass(frozen=True, eq=False)
class FaceGrid:
    """Uprights, levels, and the fit of both over `observations`; source (N,): the row of each in FeaturePoints.

    The fit's states (n, 6) are as in adjust.py; its edges: x of uprights' left and right edges, then y of levels' lower
    and upper edges.
    """

    sightings: FaceSightings
    uprights: Uprights
    levels: Levels
    fit: GridFit
    observations: EdgeObservations
    source: Ints
    feet: Feet


def observed_edges(sightings: FaceSightings, uprights: Uprights, levels: Levels) -> tuple[EdgeObservations, Ints]:
    """All observations of the uprights' edges (both ends) and beams' corners, and the row of each in FeaturePoints."""
    vertical, posts = upright_edges(sightings, uprights)
    beams = np.flatnonzero(levels.which >= 0)
    level = 2 * (len(uprights.x) + levels.which[beams])[:, None, None] + np.arange(2) + np.zeros((2, 1), dtype=np.int64)
    usable = (sightings.corners[beams] >= 0) & levels.ends[beams][:, :, None]
    horizontal, corners = edge_observations(sightings, sightings.corners[beams][usable], level[usable], 1)
    both = zip(vars(vertical).values(), vars(horizontal).values(), strict=True)
    return EdgeObservations(*(np.concatenate(pair) for pair in both)), np.concatenate([posts, corners])


def fit_grid(
    features: Sequence[Feature], facts: RowFacts, settings: TrackingSettings, attitudes: Floats | None = None
) -> FaceGrid:
    """Find the grid in the features of all frames. attitudes (n, 3, 3): world_from_rig as far as known (see `rectified`).

    Raises StructureError where there are too few frames, too little motion, or no uprights or beams.
    """
    collected = collect_sightings(features, facts)
    _require_sightings(collected, facts, settings)
    sightings = on_face(collected, _attitudes(collected, facts, attitudes))
    passes = [frames for name in dict.fromkeys(facts.frames.passes) if len(frames := facts.frames.of_pass(name))]
    states = np.tile([1.0, 0, 0, 0, 0, 0], (len(facts.frames), 1))
    spacing = sightings.upright_spacing()
    if not np.isfinite(spacing):
        raise StructureError(f"row {facts.name}: no picture shows two uprights; widen the view or check its direction")
    views = frame_observations(sightings, len(facts.frames))
    sizes = (0.06 * spacing, 0.18 * spacing, settings.upright_support)
    for frames in passes:
        odometry = pass_odometry(views, facts, frames, spacing)
        states[frames] = along_uprights(sightings, views, odometry, sizes)
    expected = bool(sightings.points.expected.any())
    fitter = GridFitter(facts.name, sightings, settings, spacing, feet_of(features, sightings), trusting=expected)
    if len(passes) > 1:
        states = _joined([fitter.grid(states, frames) for frames in passes], passes, facts.name)
    all_frames = np.arange(len(facts.frames))
    grid = fitter.grid(states, all_frames)
    second = _with_second_readings(grid)
    if second is None and not expected:
        return grid
    return replace(fitter, sightings=second or sightings, trusting=False).grid(grid.fit.states, all_frames)


def _through_passages(grid: FaceGrid) -> Bools:
    """Which levels (k,) are of racks behind, seen through passages."""
    scatter = np.zeros(2 * len(grid.levels.y))
    residual, edge = np.abs(grid.fit.residual), grid.observations.edge - 2 * len(grid.uprights.x)
    for number in np.unique(edge[edge >= 0]):
        scatter[number] = np.median(residual[edge == number])
    return seen_through(grid.levels.section, scatter.reshape(-1, 2))


def _with_second_readings(grid: FaceGrid) -> FaceSightings | None:
    """The sightings with second readings of edges instead of the first where all frames together speak for them, and without those of edges that goods
    hide; None where neither is anywhere.

    Of an edge that was read elsewhere by most, frames without such a reading tell nothing.
    """
    sightings, levels = grid.sightings, grid.levels
    first, second = (
        edges_of(np.where(levels.ends[:, :, None], heights_of(sightings, corners, grid.fit.states), np.nan))
        for corners in (sightings.corners, sightings.second)
    )
    accepted = accepted_readings(levels.section, levels.which, first, second)
    expected = expected_levels(sightings, levels.which, len(levels.section))
    hidden = hidden_edges(levels.which, first, expected & ~accepted.edges.any(axis=1))
    if not (accepted.edges | hidden).any():
        return None
    corners = np.where(accepted.second[:, None], sightings.second, sightings.corners)
    lost = (accepted.edges | hidden)[levels.which] & (levels.which >= 0)[:, None] & ~accepted.first & ~accepted.second
    return replace(sightings, corners=np.where(lost[:, None], -1, corners)).without_beams(np.asarray(lost.all(axis=1)))


def _require_sightings(sightings: Sightings, facts: RowFacts, settings: TrackingSettings) -> None:
    shown = np.unique(sightings.upright_frame)
    if not len(shown):
        raise StructureError(
            f"row {facts.name}: no upright was found in any of {len(facts.frames)} frames; check the view's direction"
        )
    if not len(sightings.corners):
        raise StructureError(
            f"row {facts.name}: no beam that meets an upright was found in any of {len(facts.frames)} frames"
        )
    if len(shown) < settings.least_frames:
        raise StructureError(
            f"row {facts.name}: uprights were found in {len(shown)} frames only, {settings.least_frames} are needed"
        )


def _attitudes(sightings: Sightings, facts: RowFacts, attitudes: Floats | None) -> Floats:
    """World_from_rig (n, 3, 3): those given, or those of views that face the rack, turned so that edges are level and plumb."""
    begins = np.array([a != b for a, b in pairwise(facts.frames.passes)], dtype=np.bool_)
    neighbour = np.where(begins, np.inf, np.radians(1.0 if attitudes is not None else 2.0))
    if attitudes is not None:
        return rectified(sightings, attitudes, neighbour, np.radians(3.0))
    main = int(np.bincount(sightings.upright_view, minlength=len(sightings.views)).argmax())
    start = np.tile(facing(sightings.views[main]), (len(facts.frames), 1, 1))
    return rectified(sightings, start, neighbour, np.radians(20.0))


def _joined(grids: Sequence[FaceGrid], passes: Sequence[Ints], row: str) -> Floats:
    """States of all passes in the frame of the one that saw most."""
    shapes = [PassGrid(g.uprights.x.mean(axis=1), g.levels.section, g.levels.y.mean(axis=1)) for g in grids]
    main = int(np.argmax([len(shape.y) for shape in shapes]))
    states = grids[main].fit.states.copy()
    for index, (grid, frames) in enumerate(zip(grids, passes, strict=True)):
        if index != main:
            similarity = laid_on(shapes[main], shapes[index])
            if similarity is None:
                raise StructureError(
                    f"row {row}: passes {index + 1} and {main + 1} do not show enough of the same bays"
                )
            states[frames] = transformed(grid.fit.states[frames], similarity)
    return states


@dataclass(frozen=True, eq=False)
class GridFitter:
    """Finds uprights and levels of a row and fits the grid, in turns that sharpen each other.

    `trusting`: whether levels are kept that are thin for beams and that all frames together show. A beam that goods hide in part has its
    usual height once second readings of its edges are taken, one of a rack behind stays thin.
    """

    row: str
    sightings: FaceSightings
    settings: TrackingSettings
    spacing: float
    feet: Feet
    trusting: bool = False

    def grid(self, states: Floats, frames: Ints) -> FaceGrid:
        """The grid that `frames` show, from a rough path `states` (n, 6)."""
        for width, height in ((0.06, 0.6), (0.04, 0.4), (0.03, 0.35)):
            uprights, levels = self._elements(states, frames, width, height)
            grid = self._fitted(states, uprights, levels)
            states = filled(states, grid.fit.states, grid.observations, frames, 6)
        if (behind := _through_passages(grid)).any():
            grid = self._fitted(states, uprights, grid.levels.without(behind))
            states = filled(states, grid.fit.states, grid.observations, frames, 6)
        return replace(grid, uprights=replace(uprights, x=grid.fit.edges[: 2 * len(uprights.x)].reshape(-1, 2)))

    def _fitted(self, states: Floats, uprights: Uprights, levels: Levels) -> FaceGrid:
        observations, source = observed_edges(self.sightings, uprights, levels)
        start = np.concatenate([uprights.x.ravel(), levels.y.ravel()])
        fit = adjusted(states, start, observations, STATE_PRIOR, rounds=4)
        return FaceGrid(self.sightings, uprights, levels, fit, observations, source, self.feet)

    def _elements(self, states: Floats, frames: Ints, width: float, height: float) -> tuple[Uprights, Levels]:
        """Uprights and levels of `frames`; kernels' width as a share of the spacing, height as one of a beam's height."""
        limits = (width * self.spacing, 3 * width * self.spacing, self.settings.upright_support)
        uprights = find_uprights(self.sightings, states, frames, limits)
        if len(uprights.x) < 2:
            raise StructureError(
                f"row {self.row}: {len(uprights.x)} upright found; a bay needs two, so the row is seen only in part"
            )
        kernel = (height, self.settings.level_support)
        floor = self.feet.floor(states, uprights.x)
        levels = find_levels(self.sightings, states, uprights, frames, kernel, floor, self.trusting)
        if not len(levels.section):
            raise StructureError(f"row {self.row}: {len(uprights.x)} uprights but no beam between them were found")
        return uprights, levels
