"""What is free along an aisle: between faces, and under what hangs over it."""

from dataclasses import replace

import numpy as np
import pytest

from savmap.apps.inspection.aisle import aisle_inspections, lowest_of, narrowest_of
from savmap.site.limits import EnvelopeLimits
from savmap.types import FrameTable, Placement, RowMap, SiteMap, Structure, Trajectory
from savmap.types.inspection import Grade

SIGMA_M, PLACE_SIGMA_M = 0.002, 0.01


def part(name: str, *points: tuple[float, float, float]) -> Structure:
    covariances = np.tile(SIGMA_M**2 * np.eye(3), (len(points), 1, 1))
    return Structure(name, "part", np.array(points), covariances, ("v",) * len(points), np.zeros((0, 2), np.int64))


def row(name: str, *parts: Structure) -> RowMap:
    path = Trajectory(np.arange(1), np.eye(4)[None])
    return RowMap(name, FrameTable(np.zeros(1), ("pass 1",)), {}, path, {"parts": parts}, ())


def place(x: float, z: float, heading: float) -> Placement:
    return Placement(x, z, heading, np.diag([PLACE_SIGMA_M**2, PLACE_SIGMA_M**2, 1e-12]))


def site() -> SiteMap:
    """Two rows 3 m from each other, 10 m long; a bar stands 5 cm out of A's face at x = 4, a box 20 cm out of B's there
    where that is opposite; and one back to back with A."""
    ends = part("ends", (0, 0, 0), (10, 0, 0))
    tall = part("tall sign", (6.5, 5.5, 1.0))
    a = row(
        "A",
        ends,
        part("bar", (4, 1, 0.05)),
        part("lamp", (2, 4.5, 1.5), (3, 4.4, 1.5)),
        part("board", (8, 6, 2.0), (8, 5.9, 2.0)),
    )
    b = row("B", ends, part("box", (6.5, 1, 0.2)), part("high", (6.0, 5, 0.28)), tall)
    places = {"A": place(0, 0, 0), "B": place(10, 3.0, 180), "C": place(10, -1.2, 180)}
    return SiteMap({"A": a, "B": b, "C": row("C", ends)}, {}, {}, places)


def grades(envelope: EnvelopeLimits) -> dict[str, tuple[Grade, float | None]]:
    parts = aisle_inspections(site(), envelope)
    return {finding.code: (finding.grade, finding.value) for name in "BA" for finding in parts[name].findings}


def test_the_narrowest_place_is_told_with_what_stands_there() -> None:
    narrowest = narrowest_of(site(), site().rows["A"], 4.0)
    assert narrowest is not None
    assert (narrowest.across, narrowest.subjects) == ("B", ("bar", "box"))
    assert narrowest.width.value == pytest.approx(3.0 - 0.05 - 0.2)
    assert narrowest.width.sigma == pytest.approx(np.hypot(SIGMA_M, PLACE_SIGMA_M) * 2**0.5, rel=1e-3)
    assert narrowest.place[0] == pytest.approx(3.75)
    higher = narrowest_of(site(), site().rows["B"], 6.0)
    assert higher is not None
    assert (higher.across, higher.width.value) == ("A", pytest.approx(3.0 - 0.05 - 0.28))


def test_rows_back_to_back_and_rows_without_a_place_have_no_aisle() -> None:
    assert narrowest_of(site(), site().rows["C"], None) is None
    unplaced = replace(site(), placements={})
    assert narrowest_of(unplaced, unplaced.rows["A"], None) is None
    assert "the width of the aisle" in aisle_inspections(unplaced, EnvelopeLimits())["A"].unchecked[0]


def test_the_lowest_element_over_the_aisle_is_told() -> None:
    lowest = lowest_of(site().rows["A"])
    assert lowest is not None
    assert (lowest.id, lowest.height.value, lowest.height.sigma) == ("lamp", 4.4, pytest.approx(SIGMA_M))
    assert lowest_of(site().rows["C"]) is None


def test_an_envelope_is_swept_along_the_aisle() -> None:
    assert grades(EnvelopeLimits()) == {}
    assert grades(EnvelopeLimits(width_m=2.5, height_m=4.2)) == {
        "narrow-aisle": ("green", pytest.approx(2.75)),
        "low-overhead": ("green", pytest.approx(4.4)),
    }
    assert grades(EnvelopeLimits(width_m=2.7, height_m=4.45)) == {
        "narrow-aisle": ("amber", pytest.approx(2.75)),
        "low-overhead": ("red", pytest.approx(4.4)),
    }
    (table,) = aisle_inspections(site(), EnvelopeLimits())["A"].tables
    assert [line[0] for line in table.lines] == ["row B", "lamp, above"]
