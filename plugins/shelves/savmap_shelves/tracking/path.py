"""The camera's path past the uprights before any beam is known: the odometry's chain, its drift taken out.

Uprights stand so far apart that they are not confused even on a drifting path. Fitting them alone fixes place and scale
of each frame; then only the rise from frame to frame is left to be chained.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array, eye_array
from scipy.sparse.linalg import spsolve

from savmap.types import Floats, Ints, RowFacts
from savmap_shelves.tracking.odometry import FrameObservations, chained, rise_between, shifts, steps_between
from savmap_shelves.tracking.sightings import FaceSightings
from savmap_shelves.tracking.uprights import Uprights, find_uprights

RATIO_SIGMA, SLIDE_SIGMA, UPRIGHT_SIGMA = 0.01, 0.02, 0.012
TAIL = 2.0
"""Sigmas from which on the loss of an edge, and of a step, grows slowly."""
LONGEST = 20.0
GAPS, NO_VOTE, RISE_SIGMA = (1, 2, 4), 0.05, 0.02


@dataclass(frozen=True, eq=False)
class EdgeObservations:
    """N observations of uprights' edges: frame, edge (index of its coordinate), tangent p and its sigma."""

    frame: Ints
    edge: Ints
    p: Floats
    sigma: Floats


@dataclass(frozen=True, eq=False)
class PassOdometry:
    """The frames (f,) of a pass, and the motion from each to the next (f - 1, 3): ratio, slide and rise."""

    frames: Ints
    steps: Floats


def pass_odometry(views: Sequence[FrameObservations], facts: RowFacts, frames: Ints, spacing: float) -> PassOdometry:
    """The motion between the frames of a pass. spacing: of the uprights, as a tangent.

    Frames that show nothing are passed over: those on either side are laid on one another, at the pace of the others.
    """
    stamps = facts.frames.stamps_s[frames]
    usual = float(np.median(np.diff(stamps))) if len(stamps) > 1 else 0.0
    index = np.flatnonzero([len(views[frame].kind) > 0 for frame in frames])
    times = np.clip(np.diff(stamps[index]) / usual, 0.2, LONGEST) if usual > 0 else np.ones(max(len(index) - 1, 0))
    showing = [views[frame] for frame in frames[index]]
    reach = float(np.clip(0.6 * spacing, 0.4, 1.5))
    moved = shifts(showing, times, reach, int(facts.travel.get(facts.frames.passes[frames[0]], 0)))
    return PassOdometry(frames, _in_parts(steps_between(showing, moved), index, len(frames)))


def _in_parts(steps: Floats, index: Ints, count: int) -> Floats:
    """Steps (count - 1, 3) between all frames, from those (n - 1, 3) between the frames at `index` (n,).

    They are equal where a step passes over frames; beyond the ends there is no motion.
    """
    whole = np.tile([1.0, 0.0, 0.0], (max(count - 1, 0), 1))
    for (ratio, slide, rise), first, last in zip(steps, index[:-1], index[1:], strict=True):
        part = ratio ** (1 / (last - first))
        share = 1 / (part ** np.arange(last - first)).sum()
        whole[first:last] = (part, slide * share, rise * share)
    return whole


def along_uprights(
    sightings: FaceSightings,
    views: Sequence[FrameObservations],
    odometry: PassOdometry,
    spacing: float,
) -> Floats:
    """States (f, 3) of a pass's frames, as in `chained`, fitted to the uprights and to the odometry. spacing: of the uprights, in x."""
    frames, steps = odometry.frames, odometry.steps
    states = np.tile([1.0, 0, 0], (len(sightings.world_from_rig), 1))
    states[frames] = chained(steps)
    for _ in range(3):
        uprights = find_uprights(sightings, states, frames, spacing)
        observations = upright_edges(sightings, uprights)
        states[frames, :2] = _fitted(states[frames, :2], uprights.x.ravel(), observations, odometry)
    states[frames, 2] = _heights(views, states, frames) * states[frames, 0]
    return states[frames]


def _heights(views: Sequence[FrameObservations], states: Floats, frames: Ints) -> Floats:
    """t_y (f,) of a pass's frames from the rises between frames up to four apart: robust, so that no single frame breaks it."""
    links = [(k, k + gap) for gap in GAPS for k in range(len(frames) - gap)]
    change, votes = np.zeros(len(links)), np.zeros(len(links))
    for n, (k, m) in enumerate(links):
        (s, u), (later_s, later_u) = states[frames[k], :2], states[frames[m], :2]
        rise, votes[n] = rise_between(views[frames[k]], views[frames[m]], later_s / s, later_s / s * u - later_u)
        change[n] = -rise / later_s
    rows, columns = np.repeat(np.arange(len(links)), 2), np.array(links, dtype=np.int64).ravel()
    slopes = coo_array((np.tile([-1.0, 1.0], len(links)), (rows, columns)), shape=(len(links), len(frames))).tocsr()
    height, weight = np.zeros(len(frames)), votes + NO_VOTE
    for _ in range(10):
        normal = slopes.T @ (slopes * weight[:, None]) + 1e-6 * eye_array(len(frames))
        height = spsolve(normal.tocsc(), slopes.T @ (weight * change))
        weight = (votes + NO_VOTE) / (1 + ((change - slopes @ height) / RISE_SIGMA) ** 2)
    return np.asarray(height)


def _fitted(start: Floats, x: Floats, observations: EdgeObservations, odometry: PassOdometry) -> Floats:
    """s and u (f, 2) of a pass, from its observations and odometry; x (k,) is free.

    Robust least squares with log s as unknown; the mean of log s is kept.
    """
    count, size = len(start), 2 * len(start) + len(x)
    frame = np.searchsorted(odometry.frames, observations.frame)
    sigma = np.concatenate([
        np.hypot(observations.sigma, UPRIGHT_SIGMA), np.full(count - 1, RATIO_SIGMA), np.full(count - 1, SLIDE_SIGMA)
    ])  # fmt: skip
    value = np.concatenate([np.column_stack([np.log(start[:, 0]), start[:, 1]]).ravel(), x])
    count_seen, links = len(frame), np.arange(count - 1)
    rows = np.concatenate([np.tile(np.arange(count_seen), 3), np.tile(count_seen + np.arange(2 * count - 2), 2)])
    columns = np.concatenate([
        2 * frame, 2 * frame + 1, 2 * count + observations.edge, 2 * links + 2, 2 * links + 3, 2 * links, 2 * links + 1
    ])  # fmt: skip
    ratio, slide = odometry.steps[:, 0], odometry.steps[:, 1]
    for _ in range(8):
        s, u, edge = np.exp(value[: 2 * count : 2]), value[1 : 2 * count : 2], value[2 * count :]
        misfit = np.concatenate([
            observations.p - edge[observations.edge] * s[frame] + u[frame],
            np.log(ratio * s[:-1] / s[1:]),
            ratio * u[:-1] - slide - u[1:],
        ]) / sigma  # fmt: skip
        weight = 1 / sigma / np.sqrt(1 + (misfit / TAIL) ** 2)
        by_frame = [edge[observations.edge] * s[frame], -np.ones(count_seen), s[frame]]
        slopes = np.concatenate([*by_frame, np.ones(2 * count - 2), -np.ones(count - 1), -ratio])
        jacobian = coo_array((slopes * weight[rows], (rows, columns)), shape=(len(sigma), size)).tocsr()
        normal = jacobian.T @ jacobian + 1e-3 * eye_array(size)
        value = value + spsolve(normal.tocsc(), jacobian.T @ (misfit * sigma * weight))
    solved = value[: 2 * count].reshape(-1, 2)
    drift = float(np.mean(np.log(start[:, 0]) - solved[:, 0]))
    return np.column_stack([np.exp(solved[:, 0] + drift), solved[:, 1]])


def upright_edges(sightings: FaceSightings, uprights: Uprights) -> EdgeObservations:
    """The observations of the uprights' edges, at both ends, where they meet the face."""
    at = np.flatnonzero(uprights.which >= 0)
    edge = ((2 * uprights.which[at][:, None] + np.arange(2))[:, :, None] + np.zeros(2, dtype=np.int64)).ravel()
    source = sightings.uprights[at].ravel()
    p, sigma = sightings.face.p[source], sightings.face.sigma_p[source]
    fine = np.isfinite(p) & np.isfinite(sigma)
    return EdgeObservations(sightings.points.frame[source][fine], edge[fine], p[fine], sigma[fine])
