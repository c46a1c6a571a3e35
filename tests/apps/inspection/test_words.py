"""What an inspector reads of a finding."""

import pytest

from savmap.apps.inspection.words import text_of
from savmap.types import Finding


@pytest.mark.parametrize(
    ("finding", "value", "limit", "likely"),
    [
        (
            Finding("a", "b", value=-2.07, sigma=0.8, limit=5.0, unit="mm/m", probability=0.004, over_m=7.8),
            "\u22122.07 \u00b1 0.80 mm in 1 m (\u221216 mm over 7.80 m)",
            "5.00 mm in 1 m (39 mm over 7.80 m)",
            "less than 1 % likely beyond it",
        ),
        (
            Finding("a", "b", value=0.006, sigma=0.0005, limit=0.005, probability=0.97, over_m=2.7),
            "16.2 \u00b1 1.4 mm (0.60 % of 2.70 m)",
            "13.5 mm (0.50 % of 2.70 m)",
            "97 % likely beyond it",
        ),
        (
            Finding("a", "b", value=2.3531, sigma=0.006, limit=2.9, unit="m", probability=1.0),
            "2353 \u00b1 6 mm",
            "2900 mm",
            "more than 99 % likely beyond it",
        ),
        (Finding("a", "b", value=-7.04, sigma=2.0, limit=5.0, unit="mm"), "\u22127.0 \u00b1 2.0 mm", "5.0 mm", ""),
        (Finding("a", "b", value=0.012, limit=0.01), "1.20 %", "1.00 %", ""),
        (Finding("a", "b", probability=0.53), "", "", "53 % likely"),
    ],
)
def test_figures_are_millimetres_with_their_limit(finding: Finding, value: str, limit: str, likely: str) -> None:
    text = text_of("A", finding)
    assert (text.value, text.limit, text.likely) == (value, limit, likely)


def test_the_place_is_along_the_row_and_above_the_floor() -> None:
    assert text_of("A", Finding("a", "b", place=(1.905, 0.8, 0.0))).place == "1.91 m along the row, 0.80 m high"
    assert text_of("A", Finding("a", "b")).place == ""
