"""What the terminal says of each row: two lines of a trusted one, two for each warning of another."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from savmap.apps.viewer.data import page_data
from savmap.cli.mapping import verdict_lines
from savmap.errors import MustCheckError, RowsFailedError, SolveError
from savmap.jobs.map_site import SiteRun
from savmap.maps.run_record import RunLog
from savmap.site.job import Job
from savmap.types import FrameTable, MapWarning, RowMap, SiteMap, Trajectory, Verdict
from savmap.types.maps import PROVISIONAL

PATH = Trajectory(np.zeros(0, np.int64), np.zeros((0, 4, 4)))
LENGTH = MapWarning(
    "reference-conflict",
    ("length upright 1 / left to upright 5 / right", "camera height"),
    "0.54 m off, 5 sigma",
    details=("length upright 1 / left to upright 5 / right is given as 15.452 m +- 0.003 m",),
)


def row(name: str, *warnings: MapWarning, notes: tuple[str, ...] = ()) -> RowMap:
    return RowMap(name, FrameTable(np.zeros(0), ()), {}, PATH, {}, (), verdict=Verdict(warnings, notes))


def site(*rows: RowMap, failed: tuple[str, ...] = ()) -> SiteMap:
    return SiteMap({one.name: one for one in rows}, {}, dict.fromkeys(failed, "no scale"))


def test_a_trusted_row_prints_two_lines_at_most() -> None:
    notes = ("not checked by a second reference: heights (an error of 8 cm would stay hidden)", "b", "c")
    assert [*verdict_lines(site(row("A")), Path("out"))] == ["row A: trusted"]
    lines = [*verdict_lines(site(row("A", notes=notes)), Path("out"))]
    assert lines == ["row A: trusted", f"  note: {notes[0]} (and 2 more notes in the report)"]


def test_a_warning_prints_two_lines_without_its_details() -> None:
    lines = [*verdict_lines(site(row("C", LENGTH, MapWarning("lens-seam"))), Path("out"))]
    assert lines[:4] == [
        "row C: check",
        "  reference-conflict: a reference contradicts the rest, 0.54 m off, 5 sigma",
        "    measure it again, in metres: length upright 1 / left to upright 5 / right, camera height",
        "  lens-seam: the pictures are bent at a seam",
    ]
    assert lines[5:] == ["details: out/report.html, out/map.json, savmap view out"]


def test_a_row_that_goes_on_need_not_be_checked() -> None:
    goes_on = replace(row("A", LENGTH), report={PROVISIONAL: "of 9 of 11 frames"})
    assert site(goes_on).banner == "1 of 1 row mapped provisionally, while the walk goes on: A"


@pytest.mark.parametrize(
    ("made", "banner"),
    [
        (site(row("A"), row("B"), row("C", LENGTH)), "1 of 3 rows must be checked: C"),
        (site(row("A", LENGTH), failed=("B", "D")), "2 of 3 rows could not be mapped: B, D; 1 of 3 rows must be checked: A"),
        (site(row("A", LENGTH)), "1 of 1 row must be checked: A"),
        (site(row("A")), ""),
    ],
)  # fmt: skip
def test_one_line_says_which_rows_to_check(made: SiteMap, banner: str, tmp_path: Path) -> None:
    assert made.banner == page_data(made, "", None, {})["banner"] == banner
    failed = {name: SolveError("no scale") for name in made.failed}
    run = SiteRun(made, None, RunLog(rows={}), failed, frozenset())
    job = Job.__new__(Job)
    object.__setattr__(job, "output", tmp_path)
    if not banner:
        run.raise_if_incomplete(job)
        return
    kind, begins = (RowsFailedError, banner) if failed else (MustCheckError, f"mapped, but {banner};")
    with pytest.raises(kind) as caught:
        run.raise_if_incomplete(job)
    assert str(caught.value).startswith(begins)
