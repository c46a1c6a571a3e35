"""Strips of which no frame showed an end."""

import numpy as np
import pytest

from savmap.types import Structure
from savmap_lights.open_ends import ALIKE_M, common_span, with_open_ends


def lamp(number: int, **ends: float) -> Structure:
    """A strip with the ends at these x."""
    vertices = np.array([[x, 6.0, 1.0] for x in ends.values()])
    labels = tuple(name.replace("_", " ") for name in ends)
    covariances = np.tile(1e-6 * np.eye(3), (len(ends), 1, 1))
    return Structure(f"light {number}", "light", vertices, covariances, labels, np.zeros((0, 2), int))


def strips(*lengths: float) -> list[Structure]:
    return [lamp(k + 1, end_0=3.0 * k, end_1=3.0 * k + length) for k, length in enumerate(lengths)]


def test_most_strips_have_one_length() -> None:
    assert common_span(strips(1.5, 1.51, 1.5, 1.49, 4.5)) == pytest.approx([1.5, 0, 0], abs=0.006)


def test_strips_that_differ_or_are_few_have_none() -> None:
    assert common_span(strips(1.5, 1.5, 1.5)) is None
    assert common_span(strips(1.5, 1.5, 1.5, 1.5, 2.0, 2.4)) is None


def test_an_end_that_no_frame_showed_is_where_the_others_have_it() -> None:
    *measured, first, last = with_open_ends([*strips(1.5, 1.5, 1.5, 1.5), lamp(5, end_1=14.0), lamp(6, end_0=15.0)])
    assert len(measured) == 4
    assert first.vertices[:, 0] == pytest.approx([12.5, 14.0])
    assert last.vertices[:, 0] == pytest.approx([15.0, 16.5])
    assert [item.attributes["end not seen"] for item in (first, last)] == ["end 0", "end 1"]
    assert np.sqrt(first.covariances[:, 0, 0]) == pytest.approx([ALIKE_M, 0.001], rel=0.01)


def test_without_a_common_length_it_is_left_out_and_compact_lamps_stay() -> None:
    lamps = with_open_ends([*strips(1.5, 2.5), lamp(3, centre=9.0), lamp(4, end_0=15.0)])
    assert [item.id for item in lamps] == ["light 1", "light 2", "light 3"]
    assert lamps[2].vertex_labels == ("centre",)
