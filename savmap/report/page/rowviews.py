"""A row's face view and plan as SVG figures in the row's frame, in millimetres."""

from collections.abc import Mapping, Sequence

import numpy as np

from savmap.report.drawing import Drawing, Picture
from savmap.report.page.figures import MM, Figure, Label, Layer, Shape, frame_of, joined, metre_grid, path
from savmap.report.page.summary import Summary
from savmap.report.plots import drawn_in, seen
from savmap.types import Floats, RowMap

MARGIN, PARTS = 900.0, (0.03, 0.02)
_AXES: Mapping[Picture, tuple[int, tuple[str, str, int]]] = {"face": (1, ("x", "y", -1)), "plan": (2, ("x", "z", 1))}
_SAID = {"survey": "survey", "mapped": "map", "off": "map, off by more than 5 cm or spurious"}
_MOST_POSES = 120


def face_view(summary: Summary, said: Mapping[str, str]) -> Figure | None:
    """The row as one faces it; None where no plugin draws anything of it."""
    return _view(summary, said, "face")


def plan_view(summary: Summary, said: Mapping[str, str]) -> Figure | None:
    """The row from above, with the camera's path: z, out of the face, points down the page."""
    return _view(summary, said, "plan")


def camera_paths(row: RowMap) -> list[Floats]:
    """The camera's path (n, 3) m by pass, thinned."""
    passes = np.array(row.frames.passes, dtype=object)[row.trajectory.frames]
    tracks = [row.trajectory.world_from_rig[passes == name, :3, 3] for name in dict.fromkeys(passes.tolist())]
    return [track[np.unique(np.linspace(0, len(track) - 1, _MOST_POSES).round().astype(int))] for track in tracks]


def layers_of(drawings: Sequence[Drawing], said: Mapping[str, str], flat: "Flat") -> tuple[Layer, ...]:
    """Drawings by look: the survey underneath; each mapped figure by itself, so that the pointer can tell it."""
    order = {"survey": 0, "mapped": 1, "off": 2}
    looks = dict.fromkeys((own.role, own.tone, own.kind) for own in sorted(drawings, key=lambda own: order[own.role]))
    return tuple(
        Layer(" ".join(look), _shapes([own for own in drawings if (own.role, own.tone, own.kind) == look], said, flat))
        for look in looks
    )


class Flat:
    """From metres in a row's frame to a figure's millimetres: x against `across`, the latter times `down`."""

    def __init__(self, across: int, down: int) -> None:
        self.across, self.down = across, down

    def __call__(self, points: Floats) -> Floats:
        """Points (n, 2) of (n, 3)."""
        return MM * points[:, [0, self.across]] * [1, self.down]


def _view(summary: Summary, said: Mapping[str, str], picture: Picture) -> Figure | None:
    drawings = drawn_in(summary.drawings, picture)
    if not drawings or summary.row is None:
        return None
    across, axes = _AXES[picture]
    flat = Flat(across, axes[2])
    cameras = camera_paths(summary.row) if picture == "plan" else []
    floor_m = [np.zeros((1, 3))] if picture == "face" else []
    frame = _frame(drawings, flat, [*cameras, *floor_m])
    grid, ticks = metre_grid(frame, flipped=axes[2] < 0)
    floor = Layer("floor", (Shape(f"M{frame[0]} 0h{frame[2]}"),))
    paths = [Layer("camera", tuple(Shape(path(flat(track)), "camera") for track in cameras))] if cameras else []
    return Figure(
        id=f"{summary.anchor}-{picture}",
        title=f"Row {summary.name}: {'face view' if picture == 'face' else 'plan'}",
        description=_described(summary, picture, frame),
        frame=frame,
        layers=(grid, floor, *layers_of(drawings, said, flat), *paths),
        labels=(*ticks, *_captions(drawings, flat)),
        legend=_legend(drawings, bool(cameras)),
        axes=axes,
    )


def _frame(drawings: Sequence[Drawing], flat: Flat, others: Sequence[Floats]) -> tuple[int, int, int, int]:
    """Around the structure, what else (n, 3) must be seen, and every fixture that would be cut through."""
    structure: Floats = MM * seen(drawings, flat.across) * [1, flat.down]
    points = np.concatenate([structure, *(flat(own) for own in others)])
    left, _, width, _ = frame_of(points, MARGIN, PARTS)
    fixtures = [flat(own.points) for own in drawings if own.tone == "fixture"]
    cut = [own for own in fixtures if own[:, 0].max() > left and own[:, 0].min() < left + width]
    return frame_of(np.concatenate([points, *cut]), MARGIN, PARTS)


def _shapes(drawings: Sequence[Drawing], said: Mapping[str, str], flat: Flat) -> tuple[Shape, ...]:
    named = [own for own in drawings if own.name and own.role != "survey"]
    others = [(flat(own.points), own.kind == "polygon") for own in drawings if not own.name or own.role == "survey"]
    shapes = [Shape(path(flat(own.points), own.kind == "polygon"), said.get(own.name, own.name)) for own in named]
    return (*([Shape(joined(others))] if others else []), *shapes)


def _captions(drawings: Sequence[Drawing], flat: Flat) -> tuple[Label, ...]:
    found = []
    for own in drawings:
        if own.caption:
            points = flat(own.points)
            found.append(Label(round(points[:, 0].mean()), round(points[:, 1].max()), own.caption, "caption"))
    return tuple(found)


def _legend(drawings: Sequence[Drawing], camera: bool) -> tuple[tuple[str, str], ...]:
    looks = {f"{own.role} {own.tone} {own.kind}": f"{_SAID[own.role]}: {own.legend}" for own in drawings}
    return (*looks.items(), *([("camera line", "camera's path")] if camera else []))


def _described(summary: Summary, picture: Picture, frame: tuple[int, int, int, int]) -> str:
    what = "as one faces it" if picture == "face" else "from above, the camera's side down"
    counts = ", ".join(f"{count} {label}" for label, count in summary.counts.items())
    return f"The row {what}: {counts}. The picture is {frame[2] / MM:.1f} m wide and {frame[3] / MM:.1f} m high."
