"""A pass at observation level along a rack that is mapped, without any reference: recognised, solved in the map's frame, and compared."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bench.observed_rows import driven_along
from savmap import graph
from savmap.apps.dates.returning.update import updated
from savmap.errors import StructureError
from savmap.graph import References
from savmap.lab.sim.observations import MaskErrors
from savmap.pipeline.records import LocatedRow, MeasuredRow, RowRequest, SolvedRow
from savmap.pipeline.row import collect, constrain, describe, locate, recognise, track
from savmap.plugin.manager import open_plugin
from savmap.site.model import Pass
from savmap.types import RowMap, SiteMap
from savmap.types.progress import NoteCollector, SilentMonitor

ERRORS = MaskErrors(0.1)
LEVELS = ([0.2, 1.5, 3.1, 5.0], [0.25, 1.2, 2.2, 5.5], [0.2, 1.9, 3.4, 5.2], [0.22, 1.0, 1.7, 4.6])
LENGTH = graph.KnownLength("upright 1 / left", "upright 5 / left", 4 * 2.8, 0.003)


def rack(*levels: list[float]) -> dict[str, Any]:
    bays = [{"width": 2.7, "beams": beams} for beams in levels]
    return {"upright_width": 0.1, "beam_height": 0.1, "height": 7.2, "bays": bays, "labels": 0.0, "bracing": False}


def located(name: str, shelves: dict[str, Any], seed: int, references: References, **request: Any) -> LocatedRow:
    driven = driven_along(shelves, seed, np.random.default_rng(seed), ERRORS, frames_a_section=8)
    passes = [Pass(video=Path("drive.mp4"), side="left")]
    lowest = [bay["beams"][0] for bay in shelves["bays"]]
    plugin = open_plugin("shelves", {"lowest_beam_bottom_height_m": lowest} if references.lengths else {})
    return locate(
        MeasuredRow(RowRequest(name, passes, [plugin], references, travel_m=12.0, **request), driven.measurements)
    )


def mapped(row: LocatedRow) -> RowMap:
    posed = constrain(track(row, SilentMonitor()), SilentMonitor())
    return collect(describe(SolvedRow(**vars(posed), solution=graph.solve(posed.problem))))


@pytest.fixture(scope="module")
def earlier() -> RowMap:
    return mapped(located("A", rack(*LEVELS), 1, References(lengths=(LENGTH,))))


@pytest.mark.slow
def test_a_pass_without_references_lies_in_the_map(earlier: RowMap) -> None:
    levels = [*LEVELS[1:]]
    levels[1] = [0.2, 1.8, 3.4, 5.2]
    notes = NoteCollector()
    row = recognise(located("1", rack(*levels), 2, References(), against={"A": earlier, "B": earlier_other()}), notes)
    assert any("row 1: recognised as row A: upright 2 to upright 5" in line for line in notes.lines)
    assert len(row.request.references.lengths) == 1
    assert row.request.references.lengths[0].value_m == pytest.approx(3 * 2.8, abs=0.15)
    found = mapped(row)
    assert found.name == "A"
    site_map, comparison = updated(SiteMap({"A": earlier}, {}), {"A": found}, {})
    assert [(change.name, change.state) for change in comparison.rows[0].changes] == [("bay 3 / beam 2", "moved")]
    now = {part.id: part for part in site_map.rows["A"].structures["shelves"]}
    assert now["upright 4"].vertices[:, 0].mean() == pytest.approx(3 * 2.8 + 0.05, abs=0.02)
    assert now["bay 3 / beam 2"].vertices[:, 1].mean() == pytest.approx(1.85, abs=0.02)
    assert now["bay 4 / beam 3"].attributes["bay"] == 4


def earlier_other() -> RowMap:
    return mapped(located("B", rack(*LEVELS[::-1]), 3, References(lengths=(LENGTH,))))


def test_alike_bays_are_refused(earlier: RowMap) -> None:
    alike = mapped(located("C", rack(*[LEVELS[0]] * 4), 4, References(lengths=(LENGTH,))))
    row = located("1", rack(*[LEVELS[0]] * 2), 5, References(), against={"C": alike})
    with pytest.raises(StructureError, match="row 1: the pass looks alike at several places of the earlier map: row C"):
        recognise(row, SilentMonitor())


def test_without_an_earlier_map_a_row_stays_as_it_is() -> None:
    row = located("1", rack(*LEVELS[:2]), 2, References())
    assert recognise(row, SilentMonitor()) is row
    assert row.place is None
