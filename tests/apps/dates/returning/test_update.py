"""An earlier map after another pass: what is confirmed, changed, new, missing and not seen, by the map's labels."""

from dataclasses import replace

import mapped_place as place
import numpy as np
import pytest

from savmap.apps.dates.comparison.records import Comparison
from savmap.apps.dates.returning.recognition import recognised
from savmap.apps.dates.returning.update import in_row, laid_onto, moved, updated
from savmap.errors import StructureError
from savmap.types import MapWarning, ReferenceUse, RowMap, SiteMap, Structure, Verdict

BAYS = place.irregular()
EARLIER = place.with_joint(place.mapped(BAYS, 1), 0.001)


def a_pass(bays: tuple[place.Bay, ...], seed: int = 2) -> RowMap:
    """A pass in the frame of the earlier map's row, numbered from 1."""
    row = replace(place.mapped(bays, seed).rows["A"], name="1")
    mapped = EARLIER.rows["A"]
    return in_row(row, recognised(row, {"A": mapped}), mapped)


def after(row: RowMap, earlier: SiteMap = EARLIER) -> tuple[SiteMap, Comparison]:
    return updated(earlier, {"A": row}, {"savmap": "1"})


def structures_of(site: SiteMap) -> dict[str, Structure]:
    return {part.id: part for group in site.rows["A"].structures.values() for part in group}


def test_what_both_have_keeps_its_label_and_gets_a_better_place() -> None:
    row = a_pass(BAYS[2:6])
    site_map, comparison = after(row)
    before, now = structures_of(EARLIER), structures_of(site_map)
    assert now.keys() == before.keys()
    states = {change.old_id: change.state for change in comparison.rows[0].elements}
    assert states["post 4"] == states["bay 3 / bar 2"] == "same"
    assert states["post 1"] == states["bay 8 / bar 1"] == "not seen"
    assert now["bay 8 / bar 1"] is before["bay 8 / bar 1"]
    true = [2.8 * 3 + place.POST_M / 2, 2.8 * 4 + place.POST_M / 2]
    errors = [
        abs(np.mean([part[f"post {4 + k}"].vertices[:, 0].mean() - x for k, x in enumerate(true)]))
        for part in (before, now)
    ]
    assert errors[1] < 0.003
    sigma = np.sqrt(now["post 4"].covariances[0, 0, 0])
    assert 0 < sigma <= 1.05 * np.sqrt(before["post 4"].covariances[0, 0, 0])


def test_moved_new_and_missing_bars_are_told_and_taken_over() -> None:
    bays = place.moved_bar(BAYS[2:6], 1, 2, 0.06)
    first = replace(bays[0], heights=(*bays[0].heights[:1], *bays[0].heights[2:]))
    last = replace(bays[3], heights=(*bays[3].heights, bays[3].heights[-1] + 0.9))
    site_map, comparison = after(a_pass((first, *bays[1:3], last)))
    changes = {change.name: change.state for change in comparison.rows[0].changes}
    assert changes == {"bay 4 / bar 3": "moved", "bay 3 / bar 2": "missing", "bay 6 / bar 6": "new"}
    before, now = structures_of(EARLIER), structures_of(site_map)
    by_m = now["bay 4 / bar 3"].vertices[:, 1].mean() - before["bay 4 / bar 3"].vertices[:, 1].mean()
    assert by_m == pytest.approx(0.06, abs=0.01)
    assert "bay 3 / bar 2" not in now
    assert now["bay 6 / bar 6"].vertices[:, 1].mean() == pytest.approx(last.heights[-1], abs=0.04)
    joint = site_map.rows["A"].joint
    assert joint is not None
    assert {"bay 4 / bar 3", "bay 3 / bar 2", "bay 6 / bar 6"}.isdisjoint(joint.coordinates["racks"])
    assert "bay 8 / bar 1" in joint.coordinates["racks"]


def test_a_bay_that_the_map_has_not_gets_the_next_free_numbers() -> None:
    earlier = place.mapped(BAYS[:6], 1, (0.0, 1.0))
    row = replace(place.mapped(BAYS[3:], 2).rows["A"], name="1")
    row = in_row(row, recognised(row, earlier.rows), earlier.rows["A"])
    now = structures_of(after(row, earlier)[0])
    added = now.keys() - structures_of(earlier).keys()
    assert {name.partition(" / ")[0] for name in added} == {"post 8", "post 9", "bay 7", "bay 8", "plate 7", "plate 8"}
    assert sum(name.startswith("bay 8") for name in added) == 5


def test_what_is_said_of_the_pass_has_the_maps_labels() -> None:
    old = Verdict((MapWarning("uncertain-element", ("bay 1 / bar 1",)), MapWarning("doubtful-scale")))
    earlier = replace(EARLIER, rows={"A": replace(EARLIER.rows["A"], verdict=old)})
    new = Verdict(
        (MapWarning("uncertain-element", ("bay 1 / bar 2",), details=("bay 1 / bar 2 and bay 1 / bar 23",)),),
        ("see post 1",),
    )
    use = ReferenceUse("length post 1 to post 2", 1.0, 0.1, 1.0)
    row = replace(a_pass(BAYS[2:6]), verdict=new, references=(use,), report={"note 1": "post 2 is seen", "frames": 3})
    result = after(row, earlier)[0].rows["A"]
    assert result.verdict is not None
    assert [warning.subjects for warning in result.verdict.warnings] == [("bay 3 / bar 2",), ("bay 1 / bar 1",)]
    assert result.verdict.warnings[0].details == ("bay 3 / bar 2 and bay 1 / bar 23",)
    assert result.verdict.notes == ("see post 3",)
    assert result.references[0].name == "length post 3 to post 4"
    assert result.report == {"note 1": "post 4 is seen", "frames": 3}


def test_rows_that_were_not_passed_stay_as_they_are() -> None:
    other = place.mapped(BAYS[::-1], 3, name="B").rows["B"]
    site_map, _ = after(a_pass(BAYS[2:6]), replace(EARLIER, rows={**EARLIER.rows, "B": other}))
    assert list(site_map.rows) == ["A", "B"]
    assert site_map.rows["B"] is other
    assert site_map.made_by == {"savmap": "1"}


def test_a_pass_that_fits_elsewhere_is_refused() -> None:
    row = a_pass(BAYS[2:6])
    with pytest.raises(StructureError, match="row A: the pass was recognised at one place of the row and fits another"):
        after(moved(row, np.eye(3), np.array([2.8, 0.0, 0.0])))


def test_a_pass_is_laid_onto_the_map() -> None:
    row = a_pass(BAYS[2:6])
    turned = moved(row, np.diag([1.002, 0.998, 1.0]), np.array([0.01, 0.02, 0.0]))
    motion = after(turned)[1].rows[0].motion
    assert motion is not None
    again = laid_onto(turned, motion)
    here = {part.id: part.vertices for part in again.structures["racks"]}
    mapped = structures_of(EARLIER)
    for ours, theirs in (("post 1", "post 3"), ("bay 4 / bar 5", "bay 6 / bar 5"), ("bay 1 / bar 1", "bay 3 / bar 1")):
        assert here[ours][:, :2] == pytest.approx(mapped[theirs].vertices[:, :2], abs=0.015)
    assert again.trajectory.world_from_rig[0, 0, 3] == pytest.approx(row.trajectory.world_from_rig[0, 0, 3], abs=0.02)
