"""Observations without pixels: what boundary detection would give for a scene, with the errors that networks make.

For large, fast tests of tracking and solving. The four errors of the masks (paper, "Segment structures"): a structure
is missed, given twice, incomplete in its length, or its mask is wider than the face. Beside them noise and outliers.
Occlusion by goods is ignored; what lies outside the view is cut off.
"""

from collections.abc import Hashable, Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from savmap.geometry.pinhole import project
from savmap.lab.scenes import RowFrame
from savmap.lab.sim.drive.cart import Drive
from savmap.types import Floats, ViewSpec

Side = Literal["left", "right", "lower", "upper"]

_NEAREST_M = 0.05
_LEAST_PX = 12.0


@dataclass(frozen=True, eq=False)
class ObservedEdge:
    """One edge of one mask: `pixels` (2, 2) are its ends. `instance` numbers the masks of a frame; both sides share it.

    `truth` says which structure, for checking only; None for an outlier.
    """

    frame: int
    label: str
    side: Side
    instance: int
    pixels: Floats
    truth: Hashable | None


@dataclass(frozen=True)
class MaskErrors:
    """Shares of masks with each error, and its size: px of `sigma_px` noise, `wide_px` too wide, length left.

    `bias_px`: how far outside the structure every edge lies, always; `uneven_px`: the standard deviation of what each
    edge has beside that, for good; `drift_px`: the same for what comes and goes, over about `drift_frames` frames.
    `warped_px`: the standard deviation of what all pictures are warped by, alike, where edges are measured by parts.
    """

    sigma_px: float = 0.5
    missed: float = 0.0
    duplicated: float = 0.0
    incomplete: float = 0.0
    wide: float = 0.0
    wide_px: float = 4.0
    outliers: float = 0.0
    bias_px: float = 0.0
    uneven_px: float = 0.0
    drift_px: float = 0.0
    drift_frames: float = 5.0
    warped_px: float = 0.0


PAPER = MaskErrors(
    sigma_px=0.7, missed=0.1, duplicated=0.05, incomplete=0.3, wide=0.1, outliers=0.05, bias_px=1.1, uneven_px=0.05
)
"""As in the published experiment (section IV): 640x480 views of 150 degrees from 1.5 m, 1.75 cm a pixel. Its error is
4.0 to 4.8 cm with widths over- and gaps under-estimated by about as much: an edge 1.1 px outside its structure makes a
width 3.9 cm too large. Noise: 0.7 px of a mask's edge at that size. The shares of the four mask errors are not
published; these are a guess."""


@dataclass(frozen=True, eq=False)
class Strip:
    """A structure's front in the row's frame: its class, which one it is (`truth`), its two `edges`' ends (2, 2, 3) m,
    and on which `sides` of it they are."""

    label: str
    truth: Hashable
    sides: tuple[Side, Side]
    edges: Floats


def observe_strips(
    strips: Sequence[Strip],
    frame: RowFrame,
    path: Drive,
    spec: ViewSpec,
    errors: MaskErrors,
    seed: int,
) -> Iterator[list[ObservedEdge]]:
    """The edges of a row's strips in every frame of a drive in the view `spec`; the same seed gives the same."""
    offsets = edge_offsets(len(strips), len(path.origins), errors, np.random.default_rng([seed, 1 << 20]))
    for index, (origin, turn) in enumerate(zip(path.origins, path.world_from_rig, strict=True)):
        rng = np.random.default_rng([seed, index])
        view_from_row = (turn @ spec.rig_from_view).T @ frame.world_from_row
        camera = frame.to_row(origin)
        shown = [_visible((strip.edges - camera) @ view_from_row.T, spec) for strip in strips]
        masks = [
            (strip, _grown(edges, amounts))
            for strip, edges, amounts in zip(strips, shown, offsets[index], strict=True)
            if edges is not None
        ]
        yield _edges(index, list(_masks(masks, errors, spec, rng)), errors, rng)


def edge_offsets(count: int, frames: int, errors: MaskErrors, rng: np.random.Generator) -> Floats:
    """How far (frames, count, 2) px outside its place each edge of each structure lies in each frame."""
    settled = errors.bias_px + errors.uneven_px * rng.normal(size=(count, 2))
    keep = np.exp(-1 / errors.drift_frames)
    steps = rng.normal(size=(frames, count, 2)) * np.sqrt(1 - keep**2)
    drift = np.zeros((frames, count, 2))
    drift[0] = steps[0] / np.sqrt(1 - keep**2)
    for index in range(1, frames):
        drift[index] = keep * drift[index - 1] + steps[index]
    offsets: Floats = settled + errors.drift_px * drift
    return offsets


def _grown(edges: Floats, amounts: Floats) -> Floats:
    """Edges (2, 2, 2) moved outwards, across themselves, by `amounts` (2,) px."""
    along = edges[:, 1] - edges[:, 0]
    across = np.stack([-along[:, 1], along[:, 0]], axis=-1)
    across /= np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-9)
    outwards = np.array([-1.0, 1.0]) * np.sign(across @ (edges[1].mean(0) - edges[0].mean(0)))
    moved: Floats = edges + (amounts * outwards)[:, None, None] * across[:, None]
    return moved


def _visible(edges: Floats, spec: ViewSpec) -> Floats | None:
    """Both edges' pixels (2, 2, 2), cut at the view's borders; None where either hardly shows."""
    cut = [_cut(edge, spec) for edge in edges]
    if any(edge is None for edge in cut):
        return None
    return np.array(cut)


def _cut(edge: Floats, spec: ViewSpec) -> Floats | None:
    """The part of a segment (2, 3) of the view frame that lies in the view, in pixels (2, 2)."""
    depth = edge[:, 2]
    if depth.max() <= _NEAREST_M:
        return None
    if depth.min() < _NEAREST_M:
        share = (_NEAREST_M - depth[0]) / (depth[1] - depth[0])
        edge = np.where((depth < _NEAREST_M)[:, None], edge[0] + share * (edge[1] - edge[0]), edge)
    ends = project(edge, spec.camera)
    span = ends[1] - ends[0]
    low, high = 0.0, 1.0
    for axis, size in ((0, spec.width), (1, spec.height)):
        if abs(span[axis]) < 1e-9:
            inside = -0.5 <= ends[0, axis] <= size - 0.5
            low, high = (low, high) if inside else (1.0, 0.0)
            continue
        border = np.sort((np.array([-0.5, size - 0.5]) - ends[0, axis]) / span[axis])
        low, high = max(low, float(border[0])), min(high, float(border[1]))
    if (high - low) * np.linalg.norm(span) < _LEAST_PX:
        return None
    return np.stack([ends[0] + low * span, ends[0] + high * span])


def _masks(
    seen: Sequence[tuple[Strip, Floats]], errors: MaskErrors, spec: ViewSpec, rng: np.random.Generator
) -> Iterator[tuple[Strip, bool, Floats]]:
    """The masks of what is seen, and whether each is of its strip: an outlier only looks like one."""
    for strip, edges in seen:
        if rng.random() < errors.missed:
            continue
        for _ in range(2 if rng.random() < errors.duplicated else 1):
            yield strip, True, _spoilt(edges, errors, rng)
        if rng.random() < errors.outliers:
            yield strip, False, _outlier(edges, spec, rng)


def _spoilt(edges: Floats, errors: MaskErrors, rng: np.random.Generator) -> Floats:
    """Edges (2, 2, 2) with a piece of their length lost, widened to one side or both."""
    if rng.random() < errors.incomplete:
        left = rng.uniform(0.4, 0.9)
        first = rng.uniform(0, 1 - left)
        span = edges[:, 1] - edges[:, 0]
        edges = np.stack([edges[:, 0] + first * span, edges[:, 0] + (first + left) * span], axis=1)
    if rng.random() < errors.wide:
        amounts = rng.uniform(0.3, 1.0, 2) * errors.wide_px * rng.permutation([1.0, float(rng.random() < 0.5)])
        edges = _grown(edges, amounts)
    return edges


def _outlier(edges: Floats, spec: ViewSpec, rng: np.random.Generator) -> Floats:
    """A mask like another, somewhere else and askew."""
    middle = edges.mean((0, 1))
    angle = np.radians(rng.normal(0, 8))
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    place = rng.uniform([0, 0], [spec.width, spec.height])
    moved: Floats = (edges - middle) * rng.uniform(0.3, 1.0) @ turn.T + place
    return np.clip(moved, -0.5, [spec.width - 0.5, spec.height - 0.5])


def _edges(
    frame: int, masks: Sequence[tuple[Strip, bool, Floats]], errors: MaskErrors, rng: np.random.Generator
) -> list[ObservedEdge]:
    observed = []
    for instance, (strip, genuine, edges) in enumerate(masks):
        for side, pixels in zip(strip.sides, edges, strict=True):
            noisy = pixels + rng.normal(0, errors.sigma_px, (2, 2))
            truth = strip.truth if genuine else None
            observed.append(ObservedEdge(frame, strip.label, side, instance, noisy, truth))
    return observed
