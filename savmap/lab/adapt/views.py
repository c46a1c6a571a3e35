"""The views of a map that show its outlines, evenly chosen, rendered from the video once more, and turned ones beside
them."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from savmap.lab.adapt.faces import Outline, outline_in
from savmap.lab.label.polygons import filled
from savmap.plugin.manager import LoadedPlugin
from savmap.plugin.segmenters import SegmenterPool
from savmap.site.model import Pass, pass_names
from savmap.types import Floats, RowMap, ViewSpec
from savmap.types.progress import Monitor
from savmap.video.prefetch import prefetch
from savmap.video.reader import panoramas
from savmap.vision.evidence import PackedView
from savmap.vision.views import Renderer

TRIED = 12
"""How many of a view's frames tell whether it shows outlines."""
WIDEST_DEG = 130.0
WORTH = 0.25
"""A view is used that shows so much of the outlines as a share of what the best one shows."""
YAW_DEG, PITCH_DEG, ZOOMS = 40.0, 15.0, (0.6, 1.1)
"""How far a turned view looks to the side and up or down, and how wide it is, as a share of the one beside it."""

Chosen = Mapping[int, Sequence[ViewSpec]]
"""The views to look at, by frame."""


@dataclass(frozen=True, eq=False)
class SeenView:
    """A view of a row whose camera's pose is known: its picture (h, w, 3) RGB, and what the network makes of it, by its
    classes."""

    spec: ViewSpec
    frame: int
    picture: NDArray[np.uint8]
    packed_view: PackedView
    classes: tuple[str, ...]


def poses_of(row: RowMap) -> dict[int, Floats]:
    """world_from_rig (4, 4) by frame."""
    return dict(zip(row.trajectory.frames.tolist(), row.trajectory.world_from_rig, strict=True))


def views_of(row: RowMap, outlines: Sequence[Outline]) -> list[tuple[int, ViewSpec]]:
    """The frames and views of a row's map that show its outlines, in their order."""
    frames = {spec: _frames(row, spec) for spec in row.views.values()}
    shares = {spec: _share_shown(row, spec, numbers, outlines) for spec, numbers in frames.items() if numbers}
    least = WORTH * max(shares.values(), default=0.0)
    candidates = [(frame, spec) for spec, share in shares.items() if share > least for frame in frames[spec]]
    return sorted(candidates, key=lambda candidate: (candidate[0], candidate[1].name))


def evenly(candidates: Sequence[tuple[int, ViewSpec]], count: int) -> dict[int, list[ViewSpec]]:
    """At most `count` of the views, evenly chosen, by frame."""
    chosen: dict[int, list[ViewSpec]] = {}
    for index in np.unique(
        np.linspace(0, len(candidates) - 1, min(count, len(candidates))).round().astype(int)
    ).tolist():
        frame, spec = candidates[index]
        chosen.setdefault(frame, []).append(spec)
    return chosen


def turned(spec: ViewSpec, frame: int, number: int = 0) -> ViewSpec:
    """A view of the same frame in another direction and of another width; always the same one for a number.

    The views that map a row all look straight at it from one distance: a network that learns from these alone forgets
    all others.
    """
    rng = np.random.default_rng([frame, crc32(spec.name.encode()), number])
    yaw, pitch = rng.uniform(-1, 1, 2) * (YAW_DEG, PITCH_DEG)
    hfov = spec.hfov_deg * rng.uniform(*ZOOMS)
    return replace(
        spec,
        name=f"{spec.name} turned {number + 1}",
        yaw_deg=spec.yaw_deg + float(yaw),
        pitch_deg=spec.pitch_deg + float(pitch),
        hfov_deg=min(float(hfov), WIDEST_DEG),
    )


def seen_views(
    row: RowMap, passes: Sequence[Pass], plugin: LoadedPlugin, chosen: Chosen, monitor: Monitor
) -> Iterator[SeenView]:
    """The chosen views, rendered from the video, with what the plugin's network makes of them. Raises VideoError,
    ModelError."""
    segmenters, renderer = SegmenterPool([plugin]), Renderer()
    for name, row_pass in zip(pass_names(passes), passes, strict=True):
        if name not in row.frames.passes:
            continue
        doing, first = f"row {row.name}, {name}: looking", row.frames.passes.index(name)
        total = row.frames.passes.count(name)
        with prefetch(panoramas(row_pass.clip, first), 1) as frames:
            for panorama in monitor.each(frames, doing, total):
                for spec in chosen.get(panorama.frame, ()):
                    view = renderer.render(panorama, spec)
                    seen = segmenters.predict(plugin, view)
                    yield SeenView(spec, panorama.frame, view.image, PackedView.of(view, seen), tuple(seen.classes))


def _frames(row: RowMap, spec: ViewSpec) -> list[int]:
    """The frames with a pose that a view is rendered from."""
    posed = row.trajectory.frames.tolist()
    return [f for f in posed if spec.shows(f) and spec.name.startswith(f"{row.frames.passes[f]} / ")]


def _share_shown(row: RowMap, spec: ViewSpec, frames: Sequence[int], outlines: Sequence[Outline]) -> float:
    """Which share of a view's pixels outlines take, on average."""
    poses, seen = poses_of(row), np.zeros(0)
    for index in np.unique(np.linspace(0, len(frames) - 1, TRIED).astype(int)).tolist():
        mask = np.zeros((spec.height, spec.width), np.bool_)
        for outline in outlines:
            place = outline_in(spec, poses[frames[index]], outline.corners)
            if place is not None:
                mask |= filled(place + 0.5, *mask.shape)
        seen = np.append(seen, mask.mean())
    return float(seen.mean())
