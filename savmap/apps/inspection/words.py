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
    """What is written of a finding: the value with one standard deviation, such as "-2.1 \u00b1 0.8 mm in 1 m (-16 mm
    over 7.80 m)", the limit likewise, and how likely it is beyond that, such as "57 % likely beyond it"."""
    place = likely = ""
    if finding.place is not None:
        place = f"{fixed(finding.place[0], 2)} m along the row, {fixed(finding.place[1], 2)} m high"
    if finding.probability is not None:
        percent = 100 * finding.probability
        words = "more than 99 %" if percent > 99 else "less than 1 %" if percent < 1 else f"{percent:.0f} %"
        likely = f"{words} likely{'' if finding.limit is None else ' beyond it'}"
    value, limit = _figure(finding, finding.value, finding.sigma), _figure(finding, finding.limit)
    return FindingText(row, finding, place, value, limit, likely)


def _figure(finding: Finding, number: float | None, sigma: float | None = None) -> str:
    """A number with its unit, and what a slope makes over the length, or what share of it a sag is."""
    if number is None:
        return ""
    unit = {PER_METRE: "mm in 1 m", "m": "mm", "": "%" if finding.over_m is None else "mm"}.get(
        finding.unit, finding.unit
    )
    spread = "" if sigma is None else f" \u00b1 {_number(finding, sigma)}"
    size = f"{_number(finding, number)}{spread} {unit}"
    if finding.over_m is None:
        return size
    over = f"{fixed(finding.over_m, 2)} m"
    if finding.unit == PER_METRE:
        return f"{size} ({fixed(number * finding.over_m, 0)} mm over {over})"
    return f"{size} ({fixed(100 * number, 2)} % of {over})"


def _number(finding: Finding, number: float) -> str:
    if finding.unit == PER_METRE:
        return fixed(number, 2)
    if finding.unit == "m":
        return fixed(MM * number, 0)
    if finding.unit == "":
        return fixed(100 * number, 2) if finding.over_m is None else fixed(MM * number * finding.over_m, 1)
    return fixed(number, 1)
