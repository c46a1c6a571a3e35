"""How deep flat parts lie, on its way from the pictures to the solve."""

import numpy as np
import pytest

from savmap.graph import References, camera_priors
from savmap.pipeline.records import LocatedRow, RowMeasurements, RowRequest, TrackedRow
from savmap.pipeline.row import constrain, track
from savmap.types import FlatDepth
from savmap.types.progress import NoteCollector, SilentMonitor
from savmap.vision.markers import MarkerTracks

from ..graph import made_up_wall as made

CORNER = made.NAMES[0]
TRUE_M = float(made.CORNERS[0, 2])


def depth(share: float, plugin: str = "stripes", landmark: str = CORNER) -> FlatDepth:
    return FlatDepth(plugin, landmark, "z", share, 0.0004, np.arange(made.FRAMES), 17, 0.0, 0.001)


def tracked(depths: tuple[FlatDepth, ...], *, known: bool, references: References) -> tuple[TrackedRow, list[str]]:
    """A row whose camera's path starts with a wrong scale, after tracking, and the notes."""
    start, notes = made.path(1.3), NoteCollector()
    seen = RowMeasurements(
        made.FACTS, {"wall": [], "stripes": []}, {}, frozenset({"wall"}), (), MarkerTracks((), {}), depths=depths
    )
    request = RowRequest("A", (), made.rooms(known=known), references)
    row = LocatedRow(request, seen, start, camera_priors(made.FACTS, start, references))
    return track(row, notes), notes.lines


@pytest.mark.parametrize("known", [True, False])
def test_a_depth_goes_into_the_solve_in_metres(known: bool) -> None:
    references = made.references() if known else made.references(made.LENGTH)
    row, _ = tracked((depth(TRUE_M / 2.5),), known=known, references=references)
    problem = constrain(row, SilentMonitor()).problem
    key = row.constraints["stripes"].keys[CORNER]
    (relation,) = [one for one in problem.relations if (one.axis, one.a, one.b) == ("z", key, None)]
    assert relation.value == pytest.approx(TRUE_M, abs=0.003)
    assert 0.001 < relation.sigma < 0.002
    assert row.figures == {f"places that tell how deep {CORNER} lies": 17}


def test_a_depth_that_cannot_be_is_left_out_and_told() -> None:
    wrong = depth(0.02, "wall", "post 3")
    row, notes = tracked((wrong,), known=True, references=made.references())
    assert row.figures == {}
    key = row.constraints["wall"].keys["post 3"]
    assert [one.value for one in row.constraints["wall"].relations if one.axis == "z" and one.a == key] == [0.0]
    assert [note for note in notes if "post 3" in note] == [
        "row A: what shows at post 3 and the like would lie at z = 5.0 +- 0.1 cm: other things hang there, so it does not tell how deep they lie"
    ]


def test_without_scale_the_solve_tells_what_is_missing() -> None:
    row, _ = tracked((depth(TRUE_M / 2.5),), known=False, references=made.references())
    assert row.figures == {}
