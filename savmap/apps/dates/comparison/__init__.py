"""Two maps of one place, made at different times: what both share, and what changed."""

from savmap.apps.dates.comparison.compare import LEVEL, Openings, compare_maps
from savmap.apps.dates.comparison.records import (
    CHANGES,
    Comparison,
    Difference,
    ElementChange,
    RowComparison,
    RowMotion,
    ScaleDifference,
    State,
)
from savmap.apps.dates.comparison.texts import as_json, comparison_lines, comparison_text, unsaid_text

__all__ = [
    "CHANGES",
    "LEVEL",
    "Comparison",
    "Difference",
    "ElementChange",
    "Openings",
    "RowComparison",
    "RowMotion",
    "ScaleDifference",
    "State",
    "as_json",
    "compare_maps",
    "comparison_lines",
    "comparison_text",
    "unsaid_text",
]
