"""Rows of a drive whose sides are swapped: the references of each fit what the other shows."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from savmap.errors import SiteError
from savmap.graph import KnownLength, References, camera_priors
from savmap.pipeline.records import LocatedRow, MeasuredRow, RowMeasurements, RowRequest, SolvedRow
from savmap.pipeline.row import constrain, solve, track
from savmap.plugin.hookspecs import hookimpl
from savmap.plugin.manager import loaded_plugin
from savmap.types import RowFacts, Track
from savmap.types.progress import NoteCollector, SilentMonitor
from savmap.vision.markers import MarkerTracks

from ..graph import made_up_wall as made

COLUMNS = {"left": (0.0, 1.0, 2.0, 3.0, 4.0), "right": (0.0, 1.0, 2.4, 3.0, 4.0)}
"""Where the posts of either face stand along it, m."""


class Wall(made.Wall):
    """Of which either side has its own posts, as the row's name tells."""

    @hookimpl
    def track(self, facts: RowFacts) -> list[Track]:
        points = made.WALL.copy()
        points[:, 0] = np.repeat(COLUMNS[facts.name], 3)
        return [made.track(f"post {number}", point, "post") for number, point in enumerate(points)]


def located(side: str, lengths: Sequence[float]) -> LocatedRow:
    """A row that is seen on this side, with the lengths that are given from its first post to its third and its fifth."""
    facts = replace(made.FACTS, name=side)
    ends = zip(("post 6", "post 12"), lengths, strict=True)
    references = References((made.CAMERA_HEIGHT,), tuple(KnownLength("post 0", end, m, 0.001, "x") for end, m in ends))
    request = RowRequest(facts.name, (), [loaded_plugin("wall", Wall, made.Config())], references)
    measured = RowMeasurements(facts, {"wall": []}, {}, frozenset({"wall"}), (), MarkerTracks({}, {}))
    return LocatedRow(request, measured, made.path(), camera_priors(facts, made.path(), references))


@pytest.mark.parametrize(
    ("left", "right", "swapped"),
    [((2.4, 4.0), (2.0, 4.0), True), ((2.0, 4.0), (2.4, 4.0), False), ((2.2, 4.0), (2.4, 4.0), False)],
    ids=["swapped", "right", "one wrong"],
)
def test_sides_that_are_swapped_are_told_in_one_line(
    left: tuple[float, float], right: tuple[float, float], swapped: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Five wrong references were named, which were all right, and never `side`."""
    monkeypatch.setattr(MeasuredRow, "moments", list(enumerate(made.FACTS.frames.stamps_s)))
    rows, said = [located("left", left), located("right", right)], NoteCollector()
    solved = solve([constrain(track(row, SilentMonitor()), SilentMonitor()) for row in rows], rows, said)
    lines = {str(row) for row in solved if isinstance(row, SiteError)}
    told = "rows left and right: the references of each fit the other: swap their `side`"
    assert lines == ({told} if swapped else set())
    if swapped:
        assert not any("measure it again" in line for line in said.lines)
    else:
        kept = [row for row in solved if isinstance(row, SolvedRow)]
        assert [bool(row.solution.warnings) for row in kept] == [left != (2.0, 4.0), False]
