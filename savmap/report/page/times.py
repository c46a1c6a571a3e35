"""How long a run took: stages by row, and over all rows."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

from savmap.report.page.numbers import duration, fixed
from savmap.report.page.summary import Summary
from savmap.report.page.tables import Cell, Line, Part, Table, heads, number

if TYPE_CHECKING:
    from savmap.maps.run_record import RunLog

LOOKS = 10


def stages(log: "RunLog") -> dict[str, float]:
    """Seconds on the clock by stage, over all rows, in the order of the rows' own records."""
    total: dict[str, float] = {}
    for row in log.rows.values():
        for name, seconds in row.seconds.items():
            total[name] = total.get(name, 0.0) + seconds
    return total


def stage_looks(log: "RunLog") -> dict[str, str]:
    """Which colour each stage has."""
    return {name: f"stage-{k % LOOKS}" for k, name in enumerate(stages(log))}


def stage_table(log: "RunLog") -> Table:
    """A line for each stage: seconds over all rows and its share of them."""
    total, looks = stages(log), stage_looks(log)
    whole, most = sum(total.values()) or 1.0, max(total.values(), default=0.0) or 1.0
    lines = tuple(
        Line(
            (
                Cell(name),
                Cell("", seconds, bar=(Part(seconds / most, looks[name], duration(seconds)),)),
                number(seconds, fixed(seconds, 1)),
                number(seconds / whole, fixed(100 * seconds / whole, 1)),
            )
        )
        for name, seconds in total.items()
    )
    return Table(
        "stages",
        "Stages over all rows; those that overlap count each by itself",
        heads("stage", "'time", "seconds", "%"),
        lines,
    )


def time_table(rows: Sequence[Summary], log: "RunLog") -> Table:
    """A line for each row: its stages as one bar, seconds, frames, memory."""
    longest = max((sum(row.seconds.values()) for row in log.rows.values()), default=0.0) or 1.0
    names = ("row", "'state", "'stages", "seconds", "frames used", "skipped", "memory, MB")
    looks = stage_looks(log)
    return Table("times", "Stages by row", heads(*names), tuple(_line(row, looks, longest) for row in rows if row.run))


def _line(row: Summary, looks: dict[str, str], longest: float) -> Line:
    run = row.run
    assert run is not None
    total = sum(run.seconds.values())
    bar = tuple(
        Part(seconds / longest, looks[name], f"{name} {duration(seconds)}") for name, seconds in run.seconds.items()
    )
    cells = (
        Cell(row.name, link=f"#{row.anchor}"),
        Cell(row.status, look=f"badge {row.status}"),
        Cell("", total, bar=bar),
        number(total, fixed(total, 1)),
        number(run.used, str(run.used)),
        number(run.skipped, str(run.skipped)),
        number(run.peak_mb, fixed(run.peak_mb, 0)),
    )
    return Line(cells, "failed" if row.row is None else "off" if run.skipped else "")
