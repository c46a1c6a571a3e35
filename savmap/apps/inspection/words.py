"""What of a finding an inspector reads: figures in millimetres, places, and how likely it is."""

from dataclasses import dataclass

from savmap.report.numbers import fixed
from savmap.types import Finding

MM = 1000.0
PER_METRE = "mm/m"


@dataclass(frozen=True)
class FindingText:
    """A finding of a row, and what is written of it: where, the value, the limit, and how likely it is beyond it; each
    "" where there is none."""

    row: str
    finding: Finding
    place: str
    value: str
    limit: str
    likely: str


def text_of(row: str, finding: Finding) -> FindingText:
    """What is written of a finding."""
    texts = place_text(finding), value_text(finding), limit_text(finding), likely_text(finding)
    return FindingText(row, finding, *texts)


def value_text(finding: Finding) -> str:
    """The value with one standard deviation, such as "-2.1 ± 0.8 mm in 1 m (-16 mm over 7.80 m)"; "" for none."""
    if finding.value is None:
        return ""
    size = f"{_number(finding, finding.value)}{_spread(finding)} {_unit(finding)}"
    return size + _over(finding, finding.value)


def limit_text(finding: Finding) -> str:
    """The limit, as the value; "" for none."""
    if finding.limit is None:
        return ""
    return f"{_number(finding, finding.limit)} {_unit(finding)}{_over(finding, finding.limit)}"


def likely_text(finding: Finding) -> str:
    """How likely the value is beyond the limit, or the finding true, such as "57 % likely"; "" where nothing tells."""
    if finding.probability is None:
        return ""
    percent = 100 * finding.probability
    words = "more than 99 %" if percent > 99 else "less than 1 %" if percent < 1 else f"{percent:.0f} %"
    return f"{words} likely{'' if finding.limit is None else ' beyond it'}"


def place_text(finding: Finding) -> str:
    """Where it is, along the row and above the floor; "" where that is not said."""
    if finding.place is None:
        return ""
    return f"{fixed(finding.place[0], 2)} m along the row, {fixed(finding.place[1], 2)} m high"


def _number(finding: Finding, number: float) -> str:
    if finding.unit == PER_METRE:
        return fixed(number, 2)
    if finding.unit == "m":
        return fixed(MM * number, 0)
    if finding.unit == "":
        return fixed(100 * number, 2) if finding.over_m is None else fixed(MM * number * finding.over_m, 1)
    return fixed(number, 1)


def _spread(finding: Finding) -> str:
    return "" if finding.sigma is None else f" \u00b1 {_number(finding, finding.sigma)}"


def _unit(finding: Finding) -> str:
    if finding.unit == "":
        return "%" if finding.over_m is None else "mm"
    return {PER_METRE: "mm in 1 m", "m": "mm"}.get(finding.unit, finding.unit)


def _over(finding: Finding, number: float) -> str:
    """What a slope makes over the length, and what share of it a sag is."""
    if finding.over_m is None:
        return ""
    over = f"{fixed(finding.over_m, 2)} m"
    if finding.unit == PER_METRE:
        return f" ({fixed(number * finding.over_m, 0)} mm over {over})"
    return f" ({fixed(100 * number, 2)} % of {over})"
