"""Which given figure belongs to which found section, where only part of a row was seen (h_ref of the paper, section III.E)."""

from collections.abc import Mapping, Sequence

from savmap.errors import SiteError

Values = float | Sequence[float]


def assignments(
    given: Mapping[str, Values], sections: Sequence[int], row: str
) -> dict[str, dict[str, dict[int, float]]]:
    """The given figures of the found sections, by setting: each one for all, or one a section of the row, left to right.

    One way where all sections were found, all runs of neighbours where the row has more, by name. Raises SiteError where it has
    fewer, or where two settings differ in number.
    """
    counts = {setting: len(values) for setting, values in given.items() if not isinstance(values, int | float)}
    if len(set(counts.values())) > 1:
        told = " and ".join(f"{count} of {setting}" for setting, count in counts.items())
        raise SiteError(f"row {row}: one value for each section is expected, but there are {told}")
    for setting, count in counts.items():
        if count < len(sections):
            raise SiteError(f"row {row}: {setting} gives {count} values, but {len(sections)} sections were found")
    whole = max(counts.values(), default=len(sections))
    lists = {
        setting: [float(values)] * whole if isinstance(values, int | float) else values
        for setting, values in given.items()
    }
    return {
        f"sections {first + 1} to {first + len(sections)} of {whole}": {
            setting: dict(zip(sections, values[first:], strict=False)) for setting, values in lists.items()
        }
        for first in range(whole - len(sections) + 1)
    }
