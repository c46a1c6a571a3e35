"""A site of made-up rows for the report's tests: posts and bars, a camera, references, places, ties, a run, scores."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from savmap.maps.run_record import FootageFile, RowRun, RunLog
from savmap.report.page import Report
from savmap.types import (
    CrossRowMatch,
    Distances,
    Drawing,
    Evaluation,
    FrameTable,
    Measured,
    Placement,
    ReferenceUse,
    RowMap,
    Score,
    SiteMap,
    Structure,
    Trajectory,
)

EVIL, ODD = "<script>alert(1)</script>", "Süd \u2013 日本 \u202e \x07" + "long " * 40
STAGES = {"decode": 60.0, "solve": 20.0}


def thing(name: str, label: str, low: tuple[float, float], high: tuple[float, float]) -> Structure:
    """A rectangle in the face plane with a height known to 3 mm."""
    corners = np.array([[low[0], low[1], 0], [high[0], low[1], 0], [high[0], high[1], 0], [low[0], high[1], 0]])
    sizes = {"height_m": high[1] - low[1], "height_sigma_m": 0.003}
    return Structure(
        name, label, corners, np.tile(4e-6 * np.eye(3), (4, 1, 1)), tuple("abcd"), np.zeros((0, 2), int), sizes
    )


def row(name: str, off: float = 0.0, sections: int = 2, levels: int = 2) -> RowMap:
    """Posts 3 m apart with bars between them; its length is off by so many sigmas."""
    posts = [thing(f"post {k + 1}", "post", (3.0 * k, 0), (3 * k + 0.1, 5)) for k in range(sections + 1)]
    bars = [
        thing(f"bay {k + 1} / bar {n + 1}", "bar", (3 * k + 0.1, n + 0.5), (3 * k + 3.0, n + 0.6))
        for k in range(sections)
        for n in range(levels)
    ]
    poses = np.tile(np.eye(4), (30, 1, 1))
    poses[:, 0, 3], poses[:, 2, 3] = np.linspace(0, 3 * sections, 30), 1.5
    frames = FrameTable(np.arange(30.0), ("pass 1",) * 30)
    used = (ReferenceUse("camera height", 3.0, 0.02, 3.01), ReferenceUse("length & all", 6.0, 0.002, 6.0 + 0.002 * off))
    return RowMap(
        name, frames, {}, Trajectory(np.arange(30), poses), {"racks": (*posts, *bars)}, used, {"residual_scale": 0.9}
    )


def assumed_top(own: RowMap) -> RowMap:
    """The row, of whose first post nobody measured the top, which may be 0.6 m higher, and of whose first bar nobody saw an edge."""
    post, *others = own.structures["racks"]
    unsure = np.tile(np.diag([4e-6, 4e-6, 4e-6]), (4, 1, 1))
    unsure[2:, 1, 1] = 0.36
    labels = ("left / bottom", "right / bottom", "right / top", "left / top")
    post = replace(post, covariances=unsure, vertex_labels=labels, attributes={"ends": "top assumed"})
    bar = next(one for one in others if one.label == "bar")
    guessed = replace(bar, attributes={"height_m": 0.1, "height_sigma_m": 0.025, "edges": "neither edge seen"})
    return replace(own, structures={"racks": (post, *(guessed if one is bar else one for one in others))})


def openings(*names: str) -> dict[str, dict[str, list[Structure]]]:
    """A bay of two levels, the upper of which is open above and stands on a bar that nobody saw."""
    bay = thing("bay 1", "bay", (0.1, 0), (2.8, 4.1))
    width = {"clear_width_m": Measured(2.7, 0.0042)}
    levels = [
        {**width, "clear_height_m": Measured(1.9, 0.002)},
        {**width, "clear_height_m": Measured(0.8, 0.02)},
        width,
    ]
    levels[1]["assumed"] = "clear height, load height assumed"
    own = [replace(bay, attributes=width)]
    own += [replace(bay, id=f"bay 1 / level {k}", attributes=level) for k, level in enumerate(levels)]
    return {name: {"racks": own} for name in names}


def drawings(own: RowMap) -> list[Drawing]:
    """What a plugin might draw of it: outlines in the face view, feet in the plan, the survey of the first post."""
    found = []
    for structure in own.structures["racks"]:
        found.append(
            Drawing("polygon", structure.vertices, "mapped", "structure", "posts & bars", ("face",), name=structure.id)
        )
        if structure.label == "post":
            foot = structure.vertices[:2]
            found.append(Drawing("line", foot, "mapped", "structure", "posts", ("plan",), structure.id, structure.id))
    survey = Drawing("polygon", own.structures["racks"][0].vertices, "survey", "structure", "posts", ("face",))
    return [*found, survey, Drawing("point", np.array([[1.0, 6, 1]]), "mapped", "fixture", "spots")]


def report(names: Sequence[str] = ("A2", "A10", EVIL, ODD), placed: bool = True) -> Report:
    """All there can be: rows that failed (one of them placed), one that is off, ties, a run and scores."""
    rows = {name: row(name, off=5.0 if name == "A10" else 0.5) for name in names}
    places = {name: Placement(0.5 * k, 4.0 * k, 180.0 * (k % 2), np.eye(3)) for k, name in enumerate(rows)}
    places["B1"] = Placement(0.0, -4.0, 0.0, np.eye(3))
    failed = {"B1": "B1: video.mp4 is <b>damaged</b> & short", "B2": "no structure"}
    sigma = np.array([0.01, 0.01, np.nan])
    ties = (
        CrossRowMatch(names[0], names[1], "post 1", "post 3", np.array([0.01, 0.0, np.nan]), sigma),
        CrossRowMatch(names[0], names[1], "post 2", "post 2", np.array([-0.04, 0.0, np.nan]), sigma),
    )
    filmed = {"pass 1": FootageFile(name="aisle.mp4", width=3840, height=1920)}
    runs = {name: RowRun(status="mapped", seconds=STAGES, used=30, peak_mb=500, footage=filmed) for name in names}
    runs["B2"] = RowRun(status="failed", error="no structure", seconds={"decode": 5.0}, skipped=2)
    site = SiteMap(rows, {"savmap": "0.1.0"}, failed, places if placed else {}, ties if placed else ())
    log = RunLog(rows=runs, wall_s=3700.0, jobs=3, ended="2026-11-27T18:42:10.00Z")
    drawn = {name: drawings(own) for name, own in rows.items()}
    return Report(site, drawn, log, evaluation(names), places=openings(*names))


def evaluation(names: Sequence[str]) -> Evaluation:
    """Errors of two classes, the same in each row; one bar missing in the first."""
    errors = {"V element": np.array([0.01, -0.03]), "H gap": np.array([0.002, 0.004, 0.006])}
    apart = {"spots": Distances(np.array([0.01, 0.03]), missing=1)}
    return Evaluation(
        {
            name: Score(
                errors, {"V edge": np.array([0.01])}, {"bar": int(k == 0)}, {"bar": 0}, apart, {"post 1": 0.0123}
            )
            for k, name in enumerate(names)
        },
        not_mapped=("Z",),
    )
