"""The camera's path along a face, up to scale, by what single frames show of its uprights (paper, section III.D).

Uprights stand so far apart that a drifting path does not confuse them. The motion from frame to frame comes from the
shift of their edges, and a fit to the uprights alone takes the drift out; then only the rise from frame to frame is
chained.
"""

from collections.abc import Sequence

import numpy as np

from savmap.errors import StructureError
from savmap.types import Feature, Floats, Ints, RowFacts, Trajectory
from savmap_shelves.tracking.density import modes
from savmap_shelves.tracking.odometry import frame_observations
from savmap_shelves.tracking.passes import PassGrid, laid_on, transformed
from savmap_shelves.tracking.path import along_uprights, pass_odometry
from savmap_shelves.tracking.sightings import FaceSightings, Sightings, collect_sightings, on_face
from savmap_shelves.tracking.uprights import Uprights, find_uprights

LEAST_FRAMES, LEAST_TRAVEL = 3, 0.2
LEVEL_KERNEL = 0.02
"""Of beams' heights, as a share of the distance from upright to upright."""


def locate(features: Sequence[Feature], facts: RowFacts, attitudes: Floats) -> Trajectory:
    """Poses of all frames before the face, z = 0, in the unit of the camera's distance from it. attitudes (n, 3, 3):
    world_from_rig.

    Raises StructureError where the frames do not show a row: too few frames or uprights, hardly any motion, or passes
    with too few bays in common.
    """
    collected = collect_sightings(features, facts)
    _require_sightings(collected, facts)
    sightings = on_face(collected, attitudes)
    spacing = sightings.upright_spacing()
    if not np.isfinite(spacing):
        raise StructureError(f"row {facts.name}: no picture shows two uprights; widen the view or check its direction")
    states = _states(sightings, facts, spacing)
    _require_motion(states, np.unique(sightings.upright_frame), facts.name)
    world_from_rig = np.tile(np.eye(4), (len(states), 1, 1))
    world_from_rig[:, :3, :3] = sightings.world_from_rig
    world_from_rig[:, :2, 3], world_from_rig[:, 2, 3] = states[:, 1:3] / states[:, :1], 1 / states[:, 0]
    return Trajectory(np.arange(len(states)), world_from_rig)


def _states(sightings: FaceSightings, facts: RowFacts, spacing: float) -> Floats:
    """States (n, 3) of all frames, as in `along_uprights`, those of all passes in one frame."""
    observations = frame_observations(sightings, len(facts.frames))
    states = np.tile([1.0, 0, 0], (len(facts.frames), 1))
    passes = [frames for name in dict.fromkeys(facts.frames.passes) if len(frames := facts.frames.of_pass(name))]
    for frames in passes:
        odometry = pass_odometry(observations, facts, frames, spacing)
        states[frames] = along_uprights(sightings, observations, odometry, spacing)
    if len(passes) == 1:
        return states
    grids = [_pass_grid(sightings, states, frames, spacing) for frames in passes]
    main = int(np.argmax([len(grid.y) for grid in grids]))
    for number, (grid, frames) in enumerate(zip(grids, passes, strict=True)):
        similarity = laid_on(grids[main], grid) if number != main else None
        if similarity is not None:
            states[frames] = transformed(states[frames], similarity)
        elif number != main:
            raise StructureError(
                f"row {facts.name}: passes {number + 1} and {main + 1} do not show enough of the same bays"
            )
    return states


def _pass_grid(sightings: FaceSightings, states: Floats, frames: Ints, spacing: float) -> PassGrid:
    """Uprights and beams' heights as single frames of a pass show them."""
    uprights = find_uprights(sightings, states, frames, spacing)
    bays, heights = _corners(sightings, states, uprights)
    here = np.isin(sightings.beam_frame, frames)[:, None, None] & np.isfinite(heights)
    levels = [
        modes(heights[here & (bays == bay)[:, None, None]], LEVEL_KERNEL * spacing)
        for bay in range(len(uprights.x) - 1)
    ]
    numbers = np.repeat(np.arange(len(levels)), [len(level) for level in levels])
    return PassGrid(uprights.x.mean(axis=1), numbers, np.concatenate([np.zeros(0), *levels]))


def _corners(sightings: FaceSightings, states: Floats, uprights: Uprights) -> tuple[Ints, Floats]:
    """The bay (m,) that each sighted beam is in, -1 where that is not sure, and y (m, 2, 2) of its corners."""
    bounds = uprights.ends_of(sightings)
    bays = np.where(bounds[:, 0] >= 0, bounds[:, 0], np.where(bounds[:, 1] >= 0, bounds[:, 1] - 1, -1))
    state = states[sightings.beam_frame][:, None, None]
    y = (sightings.face.q[sightings.corners] + state[..., 2]) / state[..., 0]
    return bays, np.where(sightings.corners >= 0, y, np.nan)


def _require_sightings(sightings: Sightings, facts: RowFacts) -> None:
    shown = np.unique(sightings.upright_frame)
    if not len(shown):
        raise StructureError(
            f"row {facts.name}: no upright was found in any of {len(facts.frames)} frames; check the view's direction"
        )
    if len(shown) < LEAST_FRAMES:
        raise StructureError(
            f"row {facts.name}: uprights were found in {len(shown)} frames only, {LEAST_FRAMES} are needed"
        )


def _require_motion(states: Floats, shown: Ints, row: str) -> None:
    travelled = float(np.ptp(states[shown, 1] / states[shown, 0]) / np.median(1 / states[shown, 0]))
    if travelled < LEAST_TRAVEL:
        raise StructureError(
            f"row {row}: too little motion: the camera moved {travelled:.2f} of its distance from the face"
            f" ({LEAST_TRAVEL} are needed)"
        )
