"""The paper's pictures (figures of the baseline aisle): face view, plan view, and the box plot of errors by class."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from savmap.evaluation import Evaluation, Score, mean_absolute_error, named_counts, pool
from savmap.report.canvas import axes_for, legend, new_axes, paint, save, window
from savmap.report.drawing import Drawing, Picture
from savmap.types import Floats, RowMap

if TYPE_CHECKING:
    from matplotlib.axes import Axes

MARGIN_M = 0.6
_PATHS = ("#1c7ed6", "#2b8a3e", "#9c36b5", "#0b7285", "#5f3dc4")


def write_face_view(drawings: Sequence[Drawing], row: RowMap, path: Path) -> None:
    """The row as one faces it, x against y: map dashed over the survey. Raises OutputError."""
    shown = drawn_in(drawings, "face")
    left, right, bottom, top = window(seen(shown, 1), MARGIN_M)
    figure, axes = axes_for((left, right, min(bottom, -0.45), top), (4.0, 8.5))
    axes.axhline(0, color="#868e96", linewidth=1.0, zorder=0)
    for drawing in shown:
        paint(axes, drawing, 1)
    _captions(axes, shown, 1)
    axes.set_ylabel("y above the floor, m")
    axes.set_title(f"Row {row.name}: face view", loc="left", fontsize=11)
    legend(figure, axes)
    save(figure, path)


def write_plan_view(drawings: Sequence[Drawing], row: RowMap, path: Path) -> None:
    """The row from above, x against z, with the camera's path by pass. Raises OutputError."""
    shown = drawn_in(drawings, "plan")
    camera = row.trajectory.world_from_rig[:, :3, 3]
    bounds = window(_with_fixtures(np.concatenate([seen(shown, 2), camera[:, [0, 2]]]), shown, 2), MARGIN_M)
    figure, axes = axes_for(bounds, (3.0, 8.5))
    axes.axhline(0, color="#868e96", linewidth=0.8, zorder=0)
    for drawing in shown:
        paint(axes, drawing, 2, **_from_above(drawing))
    _captions(axes, shown, 2)
    axes.set_ylabel("z out of the face, m")
    axes.set_title(f"Row {row.name}: plan", loc="left", fontsize=11)
    _camera_paths(axes, row)
    legend(figure, axes)
    save(figure, path)


def write_box_plot(evaluation: Evaluation, path: Path) -> None:
    """Truth - estimate by class, all rows together: box, median, whiskers to 1.5 times the box, mean in red (paper).

    Raises OutputError where the file cannot be written.
    """
    score = pool(evaluation.rows.values())
    found = {name: 100 * errors for name, errors in score.errors.items() if len(errors)}
    figure, axes = new_axes((2.5 + 1.7 * max(len(found), 2), 5.2))
    axes.axhline(0, color="#868e96", linewidth=1.0, zorder=0)
    if found:
        _boxes(axes, list(found.values()))
        legend(figure, axes)
    axes.set_xticks(range(1, len(found) + 1), [f"{name}\n({len(errors)})" for name, errors in found.items()])
    axes.set_ylabel("truth - estimate, cm")
    axes.set_xlabel(
        "class (measures); boxes: quartiles, whiskers: up to 1.5 boxes further", fontsize=9, color="#495057"
    )
    error = mean_absolute_error(score)
    figures = f"mean absolute error {100 * error:.2f} cm" if error is not None else "nothing matched"
    axes.set_title(f"{_rows(evaluation)}: {figures}\n{_counts(score)}", fontsize=11, loc="left")
    save(figure, path)


def _boxes(axes: Axes, errors: list[Floats]) -> None:
    spread = np.random.default_rng(0)
    for k, own in enumerate(errors, start=1):
        x = k + spread.uniform(-0.12, 0.12, len(own))
        axes.plot(x, own, ".", color="#4dabf7", alpha=0.6, markersize=5, zorder=2, label="one measure")
    axes.boxplot(
        errors,
        widths=0.5,
        showmeans=True,
        meanline=True,
        showfliers=False,
        medianprops={"color": "#12355b", "linewidth": 1.4},
        meanprops={"color": "#d00000", "linewidth": 1.6, "linestyle": "-"},
        zorder=3,
    )
    axes.plot([], [], color="#d00000", linewidth=1.6, label="mean")
    axes.plot([], [], color="#12355b", linewidth=1.4, label="median")


def _camera_paths(axes: Axes, row: RowMap) -> None:
    passes = np.array(row.frames.passes, dtype=object)[row.trajectory.frames]
    for k, name in enumerate(dict.fromkeys(passes.tolist())):
        track = row.trajectory.world_from_rig[passes == name, :3, 3]
        color = _PATHS[k % len(_PATHS)]
        axes.plot(track[:, 0], track[:, 2], color=color, linewidth=1.4, label=f"camera, {name}", zorder=5)
        axes.plot(*track[0, [0, 2]], "o", color=color, markersize=6, zorder=5)
        middle = len(track) // 2
        if middle:
            start, end = ((track[k, 0], track[k, 2]) for k in (middle - 1, middle))
            look = {"arrowstyle": "-|>", "color": color, "mutation_scale": 16}
            axes.annotate("", end, start, arrowprops=look, zorder=6)


def _captions(axes: Axes, drawings: Sequence[Drawing], across: int) -> None:
    """Beneath the lowest point of each drawing that has one."""
    for own in drawings:
        if own.caption:
            place = own.points[:, 0].mean(), own.points[:, across].min()
            look: dict[str, Any] = {"ha": "center", "va": "top", "fontsize": 8, "color": "#495057"}
            axes.annotate(own.caption, place, (0, -8), textcoords="offset points", **look)


def _from_above(drawing: Drawing) -> dict[str, Any]:
    """Structures are thin seen from above: a bold stroke, the survey's wider than the map's."""
    if drawing.tone == "fixture":
        return {}
    return {"linewidth": 12.0 if drawing.role == "survey" else 5.0, "linestyle": "-"}


def drawn_in(drawings: Iterable[Drawing], picture: Picture) -> list[Drawing]:
    """The drawings that belong into a picture."""
    return [own for own in drawings if picture in own.pictures]


def seen(drawings: Sequence[Drawing], across: int) -> Floats:
    """What a picture of x against axis `across` must show (n, 2): the structure, and fixtures that stand over its length."""
    structure = [own.points[:, [0, across]] for own in drawings if own.tone == "structure"]
    fixtures = [own.points[:, [0, across]] for own in drawings if own.tone == "fixture"]
    if not structure:
        return np.concatenate([*fixtures, np.zeros((1, 2))])
    x = np.concatenate(structure)[:, 0]
    over = [points for points in fixtures if x.min() <= points[:, 0].mean() <= x.max()]
    return np.concatenate([*structure, *over])


def _with_fixtures(points: Floats, drawings: Sequence[Drawing], across: int) -> Floats:
    """Points (n, 2) and those of fixtures that their window shows in part, so that none is cut through."""
    left, right, _, _ = window(points, MARGIN_M)
    fixtures = [own.points[:, [0, across]] for own in drawings if own.tone == "fixture"]
    return np.concatenate([points, *(own for own in fixtures if own[:, 0].max() > left and own[:, 0].min() < right)])


def _rows(evaluation: Evaluation) -> str:
    names = ", ".join(evaluation.rows)
    return f"Row {names}" if len(evaluation.rows) == 1 else f"{len(evaluation.rows)} rows"


def _counts(score: Score) -> str:
    return f"missing: {named_counts(score.missing)}; spurious: {named_counts(score.spurious)}"
