"""What is implausible about mapped lamps."""

from dataclasses import replace

import numpy as np
import pytest

from savmap.types import Structure
from savmap_lights.doubts import LIGHT_BEFORE, LIGHT_BEYOND, LIGHT_OFTEN, SIDES, SIDES_NOT_SEEN, UNKNOWN_M, doubts_of


def lamp(number: int, x: float, length: float = 1.2, height: float = 6.0, sigma_x: float = 0.003) -> Structure:
    ends = np.array([[x, height, 1.2], [x + length, height, 1.2]])
    covariances = np.tile(np.eye(3) * 0.003**2, (2, 1, 1))
    covariances[1, 0, 0] = sigma_x**2
    return Structure(f"light {number}", "light", ends, covariances, ("end 0", "end 1"), np.array([[0, 1]]))


def lines(lamps: list[Structure]) -> list[str]:
    return [doubt.line for doubt in doubts_of(lamps)]


def test_a_regular_line_is_beyond_doubt() -> None:
    assert not lines([lamp(k, 3.0 * k) for k in range(1, 7)])
    assert not lines([lamp(1, 0), lamp(2, 7)])


def test_a_gap_in_which_something_shines_is_doubted() -> None:
    lamps = [lamp(k, x) for k, x in enumerate([0.0, 3.0, 6.0, 9.0, 15.0, 18.0, 21.0], 1)]
    assert not lines(lamps)
    lamps[3] = replace(lamps[3], attributes={LIGHT_BEYOND: 12.5})
    (line,) = lines(lamps)
    what, figure = "a lamp may be missing in a gap", "6.00 m apart, others 3.00 m"
    assert line == f"{what}: {figure}; look at what shines between: light 4 and light 5"


def test_light_where_the_next_lamp_would_be_is_doubted() -> None:
    lamps = [lamp(k, 3.0 * k) for k in range(1, 4)]
    for attributes, x in (({LIGHT_BEYOND: 12.65}, 12.65), ({LIGHT_BEFORE: 0.55}, 0.55)):
        lit = [replace(one, attributes=attributes) for one in lamps]
        (doubt,) = doubts_of(lit)
        action = f"look at what shines beside: light {3 if x > 6 else 1}"
        assert doubt.line == f"a lamp of the line may be missing: at x {x:.2f} m; {action}"
        assert (doubt.structures, doubt.place) == ((), (x, 6.0, 1.2))
    elsewhere = [replace(one, attributes={LIGHT_BEYOND: 11.4, LIGHT_BEFORE: -2.0}) for one in lamps]
    assert not lines(elsewhere)
    irregular = [lamp(1, 0.0), lamp(2, 3.0), replace(lamp(3, 7.0), attributes={LIGHT_BEYOND: 11.1})]
    assert not lines(irregular)


def test_light_in_an_irregular_line_is_doubted() -> None:
    lamps = [lamp(k, x) for k, x in enumerate([0.0, 3.0, 8.0], 1)]
    assert not lines(lamps)
    lamps[1] = replace(lamps[1], attributes={LIGHT_BEYOND: 6.2, LIGHT_OFTEN: 0.2})
    assert not lines(lamps)
    lamps[1] = replace(lamps[1], attributes={LIGHT_BEYOND: 6.2, LIGHT_OFTEN: 0.9})
    (doubt,) = doubts_of(lamps)
    where = "at x 6.20 m; look at what shines between: light 2 and light 3"
    assert doubt.line == f"something shines that is no mapped lamp: {where}"
    assert doubt.place == (6.2, 6.0, 1.2)


def test_a_lamp_at_another_height_is_doubted() -> None:
    (line,) = lines([lamp(k, 3.0 * k, height=6.4 if k == 2 else 6.0) for k in range(1, 6)])
    assert line == "a lamp has an unusual height: 6.40 m, others 6.00 m; look whether it is one of this row: light 2"


@pytest.mark.parametrize(("off", "sigma", "count"), [(0.045, 0.01, 1), (0.045, 0.013, 0), (0.025, 0.005, 0)])
def test_another_height_is_doubted_beyond_3_cm_and_what_is_not_sure(off: float, sigma: float, count: int) -> None:
    lamps = [lamp(k, 3.0 * k, height=6.0 + off if k == 2 else 6.0) for k in range(1, 6)]
    covariances = lamps[1].covariances.copy()
    covariances[:, 1, 1] = sigma**2
    lamps[1] = replace(lamps[1], covariances=covariances)
    assert len(lines(lamps)) == count


def test_an_end_at_another_height_is_doubted() -> None:
    """Half of a strip that is 12 cm off at one end is 6 cm off, which its ends' uncertainty may explain."""
    lamps = [lamp(k, 3.0 * k) for k in range(1, 7)]
    vertices, covariances = lamps[2].vertices.copy(), lamps[2].covariances.copy()
    vertices[0, 1], covariances[0, 1, 1] = 5.88, 0.013**2
    lamps[2] = replace(lamps[2], vertices=vertices, covariances=covariances)
    (line,) = lines(lamps)
    assert line == "a lamp has an unusual height: 5.88 m, others 6.00 m; look whether it is one of this row: light 3"


@pytest.mark.parametrize("which", [1, 4])
def test_a_strip_longer_than_its_likes_is_doubted(which: int) -> None:
    lamps = [lamp(k, 3.0 * k, length=2.4 if k == which else 1.2) for k in range(1, 7)]
    assert lines(lamps)[0] == (
        f"a lamp has an unusual length: 2.40 m, others 1.20 m; look at its ends and joints: light {which}"
    )


def test_parts_of_strips_in_an_irregular_line_are_doubted() -> None:
    # half of the strips are cut by girders or joined across a joint: no length is that of most
    lengths = [0.86, 1.70, 1.69, 0.73, 4.24, 0.58, 1.72, 1.71]
    starts = np.concatenate([[0.0], np.cumsum(np.array(lengths) + 0.1)[:-1]])
    lamps = [lamp(k, float(x), length) for k, (x, length) in enumerate(zip(starts, lengths, strict=True), 1)]
    doubted = [doubt for doubt in doubts_of(lamps) if "unusual length" in doubt.headline]
    assert [doubt.structures for doubt in doubted] == [("light 1",), ("light 4",), ("light 5",), ("light 6",)]
    assert doubted[0].figure.endswith(" m, others 1.70 m")


def test_two_parts_of_one_strip_are_doubted() -> None:
    sizes = [(0.0, 0.66), (2.0, 0.66), (4.0, 0.23), (4.43, 0.23), (6.0, 0.65), (8.0, 0.66)]
    (line,) = lines([lamp(k, x, length) for k, (x, length) in enumerate(sizes, 1)])
    assert line == (
        "two lamps may be one: 0.66 m together, as 4 others; look whether they are parts of one: light 3 and light 4"
    )


def test_two_kinds_of_strips_in_one_line_of_light_are_beyond_doubt() -> None:
    lengths = [1.5, 1.5, 1.5, 0.73, 0.73, 1.5]
    starts = np.concatenate([[0.0], np.cumsum(np.array(lengths) + 0.04)[:-1]])
    assert not lines([lamp(k, float(x), length) for k, (x, length) in enumerate(zip(starts, lengths, strict=True), 1)])


def test_two_kinds_of_strips_are_beyond_doubt() -> None:
    assert not lines([lamp(k, 2.0 * k, 1.2 if k % 2 else 1.7) for k in range(1, 7)])


def test_an_end_never_seen_is_doubted_between_lamps_only() -> None:
    lamps = [lamp(k, 3.0 * k, sigma_x=UNKNOWN_M if k in (2, 4) else 0.003) for k in range(1, 5)]
    assert lines(lamps) == ["a lamp's end was never seen; look for its end: light 2"]


@pytest.mark.parametrize(("share", "doubted"), [(0.9, True), (0.5, False)])
def test_light_beside_the_only_lamp_is_doubted(share: float, doubted: bool) -> None:
    only = replace(lamp(1, 1.5), attributes={LIGHT_BEYOND: 6.2, LIGHT_OFTEN: share})
    assert ["no mapped lamp" in doubt.line for doubt in doubts_of([only])] == [True] * doubted


@pytest.mark.parametrize(("place", "doubted"), [(5.6, False), (6.6, True)])
def test_light_in_a_line_with_a_pitch_is_doubted_where_a_lamp_may_hang(place: float, doubted: bool) -> None:
    lamps = [lamp(k, x) for k, x in enumerate((0.0, 2.0, 4.0, 8.0, 12.0, 14.0), 1)]  # two are out
    lamps[2] = replace(lamps[2], attributes={LIGHT_BEYOND: place, LIGHT_OFTEN: 0.9})
    assert any("no mapped lamp" in line for line in lines(lamps)) == doubted


def test_a_lamp_whose_sides_do_not_show_is_doubted() -> None:
    (line,) = lines([replace(lamp(1, 0.0), attributes={SIDES: SIDES_NOT_SEEN})])
    assert line.startswith("a lamp's sides do not show; ")
