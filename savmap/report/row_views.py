"""A row's face view and plan as figures in the row's frame, in millimetres (the paper's figures of the baseline
aisle)."""

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain

import numpy as np

from savmap.report.scene import MM, Figure, Frame, Label, Layer, Shape, frame_of, hatching, joined, metre_grid, path
from savmap.types import Bools, Drawing, Floats, Picture, Role, RowMap, Structure

# Around what must be seen; and as parts of the width, where that is more, beside it and above and below it.
_MARGIN_MM, _PARTS = 900.0, (0.03, 0.02)
_ROLES: Mapping[Role, str] = {
    "survey": "survey",
    "mapped": "map",
    "warned": "map, warned",
    "off": "map, off by more than 5 cm or spurious",
}
SAME_M = 0.001
ASSUMED = "not measured, assumed to a standard deviation"
_MOST_POSES = 120
_PATH_COLOURS = 5


@dataclass(frozen=True)
class Projection:
    """From metres in a row's frame to a figure's millimetres: x against the axis `across` (1 or 2), which points `down`
    the page (1) or up (-1) and is stretched; and the words for such a figure."""

    across: int
    axes: tuple[str, str, int]
    title: str
    note: str
    description: str
    stretch: float = 1.0

    @property
    def down(self) -> int:
        """Whether the second axis points down the page (1) or up (-1)."""
        return self.axes[2]

    def __call__(self, points: Floats) -> Floats:
        """Points (n, 2) mm of (n, 3) m."""
        flat: Floats = points[:, [0, self.across]] * [MM, MM * self.down * self.stretch]
        return flat


_PROJECTIONS: Mapping[Picture, Projection] = {
    "face": Projection(1, ("x", "y", -1), "face view", "x along the row, y above the floor", "as one faces it"),
    "plan": Projection(
        2, ("x", "z", 1), "plan", "x along the row, z out of the face", "from above, the camera's side down"
    ),
}


def row_view(
    row: RowMap,
    drawings: Sequence[Drawing],
    picture: Picture,
    hints: Mapping[str, str] | None = None,
    anchor: str = "row",
    least_ratio: float = 0.0,
) -> Figure:
    """The row as one faces it ("face"), or from above with the camera's path, z out of the face pointing down the page
    ("plan").

    hints: by structure id, what the page shows under the pointer. least_ratio: of height to width; the vertical scale
    is larger than that along x where it takes that.
    """
    shown = drawn_in(drawings, picture)
    cameras = camera_paths(row) if picture == "plan" else {}
    on_floor = [np.zeros((1, 3))] if picture == "face" else []
    left, top, width, height = _frame(shown, _PROJECTIONS[picture], [*cameras.values(), *on_floor])
    stretch = max(1.0, least_ratio * width / height)
    projection = replace(_PROJECTIONS[picture], stretch=stretch)
    frame = (left, round(top * stretch), width, round(height * stretch))
    grid, labels = metre_grid(frame, projection.down, stretch)
    floor = Layer("floor", (Shape(f"M{left} 0h{width}"),))
    ends = _assumed_layers(row, projection)
    paths = (_camera_layers(name, projection(cameras[name]), k, width) for k, name in enumerate(cameras))
    counts = ", ".join(f"{count} {label}" for label, count in label_counts(row).items())
    size = f"The picture is {width / MM:.1f} m wide and {height / MM:.1f} m high."
    scale = f"; vertical scale {stretch:.1f} times that along x" if stretch > 1 else ""
    return Figure(
        id=f"{anchor}-{picture}",
        title=f"Row {row.name}: {projection.title}",
        description=f"The row {projection.description}: {counts}. {size}",
        frame=frame,
        layers=(grid, floor, *layers(shown, hints or {}, projection), *ends, *chain.from_iterable(paths)),
        labels=(*labels, *_captions(shown, projection)),
        legend=(*_legend(shown, cameras), *(("assumed", ASSUMED) for _ in ends)),
        axes=projection.axes,
        note=f"{projection.note}{scale}",
    )


def _assumed_layers(row: RowMap, projection: Projection) -> tuple[Layer, ...]:
    """Ends that nothing measured, hatched."""
    bands = [
        projection(band)
        for plugin, group in row.structures.items()
        for structure in group
        for axis in (0, projection.across)
        for band in _bands(structure, structure.assumed(plugin, row.joint)[:, axis], axis)
    ]
    strokes = [(stroke, False) for band in bands for stroke in hatching(band)]
    return (Layer("assumed", (Shape(joined(strokes)),)),) if strokes else ()


def _bands(structure: Structure, assumed: Bools, axis: int) -> Iterator[Floats]:
    """Corners (n, 3) m around vertices of a structure that are assumed (n,) to stand at one place along an axis, give
    or take a standard deviation."""
    points = structure.vertices[assumed]
    reach = np.sqrt(structure.covariances[assumed, axis, axis])[:, None] * np.eye(3)[axis]
    for place in np.unique(points[:, axis].round(3)):
        at = np.abs(points[:, axis] - place) < SAME_M
        yield np.concatenate([points[at] - reach[at], points[at] + reach[at]])


def drawn_in(drawings: Iterable[Drawing], picture: Picture) -> list[Drawing]:
    """The drawings that belong into a picture."""
    return [drawing for drawing in drawings if picture in drawing.pictures]


def camera_paths(row: RowMap) -> dict[str, Floats]:
    """The camera's path (n, 3) m by pass, thinned."""
    passes = np.array(row.frames.passes, dtype=object)[row.trajectory.frames]
    tracks = {name: row.trajectory.world_from_rig[passes == name, :3, 3] for name in dict.fromkeys(passes.tolist())}
    return {
        name: track[np.unique(np.linspace(0, len(track) - 1, _MOST_POSES).round().astype(int))]
        for name, track in tracks.items()
    }


def label_counts(row: RowMap) -> dict[str, int]:
    """The row's structures by label."""
    return dict(Counter(structure.label for structures in row.structures.values() for structure in structures))


def _frame(drawings: Sequence[Drawing], projection: Projection, others: Sequence[Floats]) -> Frame:
    """Around the structure, the fixtures over its length, what else (n, 3) must be seen, and all fixtures that would be
    cut through; around all fixtures and the origin where there is no structure."""
    structure = [drawing.points for drawing in drawings if drawing.tone == "structure"]
    fixtures = [drawing.points for drawing in drawings if drawing.tone == "fixture"]
    x = np.concatenate([np.zeros((0, 3)), *structure])[:, 0]
    over = [points for points in fixtures if not structure or x.min() <= points[:, 0].mean() <= x.max()]
    points = np.concatenate([projection(part) for part in (*(structure or [np.zeros((1, 3))]), *over, *others)])
    left, _, width, _ = frame_of(points, _MARGIN_MM, _PARTS)
    flat = map(projection, fixtures)
    cut = [fixture for fixture in flat if fixture[:, 0].max() > left and fixture[:, 0].min() < left + width]
    return frame_of(np.concatenate([points, *cut]), _MARGIN_MM, _PARTS)


def layers(
    drawings: Sequence[Drawing], hints: Mapping[str, str], projection: Callable[[Floats], Floats]
) -> tuple[Layer, ...]:
    """Drawings by style, the survey underneath and what is off on top."""
    order = {"survey": 0, "mapped": 1, "warned": 2, "off": 3}
    styles: dict[tuple[str, str, str], list[Drawing]] = {}
    for drawing in sorted(drawings, key=lambda drawing: order[drawing.role]):
        styles.setdefault((drawing.role, drawing.tone, drawing.kind), []).append(drawing)
    return tuple(Layer(" ".join(style), _shapes(group, hints, projection)) for style, group in styles.items())


def _shapes(
    drawings: Sequence[Drawing], hints: Mapping[str, str], projection: Callable[[Floats], Floats]
) -> tuple[Shape, ...]:
    """A shape for each structure, so that it can have its hint; the others are one."""
    named = [drawing for drawing in drawings if drawing.name and drawing.role != "survey"]
    others = [drawing for drawing in drawings if not drawing.name or drawing.role == "survey"]
    outlines = [(projection(drawing.points), drawing.kind == "polygon") for drawing in others]
    shapes = [
        Shape(path(projection(drawing.points), drawing.kind == "polygon"), hints.get(drawing.name, drawing.name))
        for drawing in named
    ]
    return (*([Shape(joined(outlines))] if outlines else []), *shapes)


def _camera_layers(name: str, track: Floats, index: int, width: int) -> tuple[Layer, ...]:
    """The path (n, 2) mm of a pass with a dot where it begins and an arrow head half way."""
    style, hint = _camera_style(index), f"camera, {name}"
    ahead = np.diff(track, axis=0)
    middle = len(track) // 2
    head = ""
    if middle and np.any(ahead[middle - 1]):
        along = 0.008 * width * ahead[middle - 1] / np.linalg.norm(ahead[middle - 1])
        across = 0.5 * np.array([-along[1], along[0]])
        head = path(track[middle] + np.array([across - along, np.zeros(2), -across - along]))
    line = Layer(style, (Shape(path(track) + head, hint),))
    return line, Layer(f"{style} point", (Shape(path(track[:1]), hint),))


def _camera_style(index: int) -> str:
    return f"camera pass-{index % _PATH_COLOURS}"


def _captions(drawings: Sequence[Drawing], projection: Projection) -> list[Label]:
    """Beneath the lowest point of each drawing that has one."""
    labels = []
    for drawing in drawings:
        if drawing.caption:
            points = projection(drawing.points)
            x, y = round(points[:, 0].mean()), round(points[:, 1].max())
            labels.append(Label(x, y, drawing.caption, "caption", dy=1.3))
    return labels


def _legend(drawings: Sequence[Drawing], cameras: Mapping[str, Floats]) -> tuple[tuple[str, str], ...]:
    styles = {
        f"{drawing.role} {drawing.tone} {drawing.kind}": f"{_ROLES[drawing.role]}: {drawing.legend}"
        for drawing in drawings
    }
    return (*styles.items(), *((f"{_camera_style(k)} line", f"camera, {name}") for k, name in enumerate(cameras)))
