"""Sizes that no rack has: references in feet, or a tenth."""

import pytest

from savmap_shelves.scale import implausible_scale

from .perfect_maps import Row, structures_of, surveyed_row


def scaled(row: Row, times: float) -> Row:
    """The row, so many times as large."""
    return {
        "uprights": [[times * x for x in upright] for upright in row["uprights"]],
        "sections": [
            {"beams": [[times * y for y in beam] for beam in section["beams"]]} for section in row["sections"]
        ],
    }


@pytest.mark.parametrize("times", [1 / 0.3048, 0.1])
def test_sizes_that_no_rack_has_are_warned_of(times: float) -> None:
    (warning,) = implausible_scale(structures_of(scaled(surveyed_row(), times)))
    assert (warning.code, warning.details[0]) == ("doubtful-scale", "no rack has such sizes")


@pytest.mark.parametrize("times", [0.5, 1.0, 1.6])
def test_light_and_heavy_racks_are_plausible(times: float) -> None:
    assert not [*implausible_scale(structures_of(scaled(surveyed_row(), times)))]
