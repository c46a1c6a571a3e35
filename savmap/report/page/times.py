"""How long a run took: stages by row, and over all rows."""

from collections import Counter
from collections.abc import Sequence

from savmap.maps.run_record import RowRun, RunLog
from savmap.report.numbers import duration
from savmap.report.page.summary import Summary
from savmap.report.page.tables import Cell, Line, Part, Table, count_cell, heads, number_cell, row_cell

STYLES = 10


def stages(log: RunLog) -> dict[str, float]:
    """Seconds on the clock by stage, over all rows, in the order of the rows' records."""
    total: Counter[str] = Counter()  # of floats here, which it adds as well
    for row in log.rows.values():
        total.update(row.seconds)
    return dict(total)


def stage_styles(log: RunLog) -> dict[str, str]:
    """The style, which is a colour, of each stage."""
    return {name: f"stage-{k % STYLES}" for k, name in enumerate(stages(log))}


def stage_table(log: RunLog) -> Table:
    """A line for each stage: seconds over all rows and its share of them."""
    total, styles = stages(log), stage_styles(log)
    whole, most = sum(total.values()) or 1.0, max(total.values(), default=0.0) or 1.0
    lines = []
    for name, seconds in total.items():
        bar = (Part(seconds / most, styles[name], duration(seconds)),)
        share = number_cell(100 * seconds / whole, 1)
        lines.append(Line((Cell(name), Cell("", seconds, bar=bar), number_cell(seconds, 1), share)))
    caption = "Stages over all rows; those that overlap count each by itself"
    return Table("stages", caption, heads("stage", "'time", "time, s", "share, %"), tuple(lines))


def time_table(rows: Sequence[Summary], log: RunLog) -> Table:
    """A line for each row: its stages as one bar, seconds, frames, memory."""
    longest = max((sum(run.seconds.values()) for run in log.rows.values()), default=0.0) or 1.0
    names = ("row", "'state", "'stages", "time, s", "frames used", "frames skipped", "memory, MB")
    styles = stage_styles(log)
    lines = tuple(_line(row, row.run, styles, longest) for row in rows if row.run)
    return Table("times", "Stages by row", heads(*names), lines)


def _line(row: Summary, run: RowRun, styles: dict[str, str], longest: float) -> Line:
    total = sum(run.seconds.values())
    bar = tuple(
        Part(seconds / longest, styles[name], f"{name} {duration(seconds)}") for name, seconds in run.seconds.items()
    )
    cells = (
        row_cell(row),
        Cell(row.status, style=f"badge {row.status}"),
        Cell("", total, bar=bar),
        number_cell(total, 1),
        count_cell(run.used),
        count_cell(run.skipped),
        number_cell(run.peak_mb, 0),
    )
    return Line(cells, "failed" if row.row is None else "off" if run.skipped else "")
