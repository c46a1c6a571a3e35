"""Tables of the page as records: cells with their text and what they are sorted by.

Rows, footage, openings and references; errors against the survey, times of the run, ties between rows, places in the
user's world."""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from savmap.maps.run_record import RunLog
from savmap.maps.search import PART
from savmap.report.evaluation import all_errors, named_counts, statistics
from savmap.report.numbers import NOTHING, centimetres, duration, fixed, natural
from savmap.report.page.summary import OFF, Summary, total_counts
from savmap.types import (
    Alignment,
    CrossRowMatch,
    Distances,
    Score,
    Structure,
)
from savmap.types.maps import OFF_SIGMAS

ASSUMED = "assumed"
"""The attribute in which a place says which of its sizes rest on what nothing measured."""


@dataclass(frozen=True)
class Part:
    """A piece of a bar: its share of the whole bar's width (0..1), its style, and its hint."""

    share: float
    style: str
    title: str


@dataclass(frozen=True)
class Cell:
    """A cell: its text, the number it is sorted by (its text where there is none), a style, a link, a smaller text
    behind it, and a bar or a small histogram (heights 0..1) instead of the text."""

    text: str
    value: float | None = None
    style: str = ""
    link: str = ""
    bar: tuple[Part, ...] = ()
    heights: tuple[float, ...] = ()
    note: str = ""


@dataclass(frozen=True)
class Head:
    """A column's heading; numbers stand to the right."""

    text: str
    number: bool = True


@dataclass(frozen=True)
class Line:
    """A line of a table; the first cell is its heading. `style`: "failed", "off", "sum", or nothing."""

    cells: tuple[Cell, ...]
    style: str = ""


@dataclass(frozen=True)
class Table:
    """A table. `filters`: the label of the box that leaves only marked lines; nothing: there is no filter."""

    id: str
    caption: str
    heads: tuple[Head, ...]
    lines: tuple[Line, ...]
    filters: str = ""

    @property
    def marked(self) -> int:
        """How many lines have a style."""
        return sum(1 for line in self.lines if line.style)


def heads(*names: str) -> tuple[Head, ...]:
    """Headings of a column of names and of columns of numbers; those with a leading `'` are of words too."""
    return tuple(Head(name.lstrip("'"), bool(k) and not name.startswith("'")) for k, name in enumerate(names))


def count_cell(count: int) -> Cell:
    """A cell of a whole number."""
    return Cell(str(count), count)


def number_cell(value: float | None, decimals: int, plus: bool = False) -> Cell:
    """A cell of a number with so many decimals."""
    return Cell(fixed(value, decimals, plus), value)


def centimetre_cells(*values_m: float | None, plus: bool = False) -> Iterator[Cell]:
    """Cells of metres, written as centimetres; a dash for none and for what is not a number."""
    for value_m in values_m:
        yield Cell(centimetres(value_m, plus), None if value_m is None or np.isnan(value_m) else float(value_m))


def row_cell(row: Summary) -> Cell:
    """A row's name, which leads to its section."""
    return Cell(row.name, link=f"#{row.anchor}")


def row_table(rows: Sequence[Summary]) -> Table:
    """A line for each row: state, counts, length, references, errors, remarks."""
    labels = list(total_counts(rows))
    scored = any(row.score for row in rows)
    error = ["mean abs error, cm"] if scored else []
    names = ("row", "'state", *labels, "length, m", "references", "worst, \u03c3", *error, "'remarks")
    lines = []
    for row in rows:
        mapped, nothing = row.row is not None, Cell(NOTHING)
        state = "check" if row.warnings else row.status
        cells = (
            row_cell(row),
            Cell(state, style=f"badge {state}"),
            *(count_cell(row.counts.get(label, 0)) if mapped else nothing for label in labels),
            number_cell(row.length_m, 2),
            count_cell(len(row.references)) if mapped else nothing,
            number_cell(max((abs(reference.deviation) for reference in row.references), default=None), 1),
            *(centimetre_cells(row.error_m) if scored else ()),
            Cell(row.error or "; ".join(row.remarks), style="words"),
        )
        lines.append(Line(cells, "failed" if not mapped else "off" if row.remarks else ""))
    filters = "only rows that failed or deserve attention"
    return Table("rows-table", "Rows; those that failed first", heads(*names), tuple(lines), filters)


def footage_table(rows: Sequence[Summary]) -> Table:
    """A line for each pass of each row: its file, the size of its pictures, how many frames were used and read, and of
    which time of the video."""
    names = ("row", "'pass", "'file", "'pictures, px", "frames used", "frames read", "from, s", "to, s", "length, s")
    lines = []
    for row, mapped in ((row, row.row) for row in rows if row.row):
        passes, files = np.array(mapped.frames.passes, dtype=object), row.run.footage if row.run else {}
        used = passes[mapped.trajectory.frames]
        for name in dict.fromkeys(mapped.frames.passes):
            stamps, file = mapped.frames.stamps_s[passes == name], files.get(name)
            start, end = float(stamps.min()), float(stamps.max())
            size = f"{file.width} \u00d7 {file.height}" if file and file.width else NOTHING
            cells = (
                row_cell(row),
                Cell(name),
                Cell(file.name if file else NOTHING),
                Cell(size, file.width if file else None),
                count_cell(int((used == name).sum())),
                count_cell(len(stamps)),
                *(number_cell(value, 1) for value in (start, end, end - start)),
            )
            lines.append(Line(cells))
    return Table("footage-table", "Footage; times are those of the file", heads(*names), tuple(lines))


def openings_table(row: Summary) -> Table | None:
    """A line for each place of a row that has sizes, such as a bay, with a column for each part of it, such as a level;
    None where there is none."""
    levels: dict[str, dict[str, Structure]] = {}
    for place in row.places:
        bay, _, level = place.id.partition(PART)
        levels.setdefault(bay, {})[level] = place
    bays = {
        bay: parts
        for bay, parts in levels.items()
        if "" in parts and any(any(place.sizes()) for place in parts.values())
    }
    if not bays:
        return None
    sizes = dict.fromkeys(("", size) for parts in bays.values() for size, _, _ in parts[""].sizes())
    columns = sizes | dict.fromkeys(
        (level, size)
        for parts in bays.values()
        for level, place in parts.items()
        for size, _, _ in place.sizes()
        if level and ("", size) not in sizes
    )
    label = next(iter(bays.values()))[""].label
    names = (label, *(f"{level}: {size}, m" if level else f"{size}, m" for level, size in columns))
    lines = tuple(
        Line((Cell(bay), *(_size_cell(parts.get(level), size) for level, size in columns)))
        for bay, parts in bays.items()
    )
    caption = "Openings, \u00b1 a standard deviation; \u2013: open, or not known"
    return Table(f"{row.anchor}-openings", caption, heads(*names), lines)


def _size_cell(place: Structure | None, size: str) -> Cell:
    """A size of a place with its standard deviation; one that rests on something that nothing measured looks so."""
    for name, value, sigma in place.sizes() if place else ():
        if place and name == size:
            style = "assumed" if size in str(place.attributes.get(ASSUMED, "")) else ""
            return Cell(fixed(value, 3), value, style, note=f"\u00b1 {fixed(sigma, 3)}")
    return Cell(NOTHING)


def reference_table(rows: Sequence[Summary]) -> Table:
    """A line for each reference of each row."""
    sigmas = ("\u03c3 given", "\u03c3 used", "in \u03c3 given")
    names = ("reference", "'row", "given", "solved", "residual", *sigmas, "'state", "'unit")
    lines = []
    for row in rows:
        for use in row.references:
            cells = (
                Cell(use.name),
                row_cell(row),
                number_cell(use.value, 4),
                number_cell(use.solved, 4),
                number_cell(use.solved - use.value, 4, True),
                number_cell(use.sigma, 4),
                number_cell(use.sigma_used, 4),
                Cell(fixed(use.deviation, 2, True), abs(use.deviation)),
                Cell(use.state),
                Cell(use.unit),
            )
            lines.append(Line(cells, "off" if use.state in OFF else ""))
    caption, filters = "References: residual is solved \u2212 given", "only those contradicted or left out"
    return Table("references-table", caption, heads(*names), tuple(lines), filters)


def class_table(score: Score) -> Table:
    """By class of measure: count, mean, mean absolute error, 95th percentile and largest of its size."""
    names = ("class", "count", "mean, cm", "mean abs, cm", "95 %, cm", "largest, cm")
    total = [("all of these", all_errors(score), "sum")] if len(score.errors) > 1 else []
    edges = [(f"{name} (place in the row)", errors, "") for name, errors in score.coordinates.items()]
    lines = []
    for name, errors, style in (*((name, errors, "") for name, errors in score.errors.items()), *total, *edges):
        given = statistics(errors)
        sizes = centimetre_cells(given.mean_absolute, given.percentile_95, given.largest)
        lines.append(
            Line((Cell(name), count_cell(given.count), *centimetre_cells(given.mean, plus=True), *sizes), style)
        )
    return Table("errors-by-class", "Truth \u2212 estimate by class", heads(*names), tuple(lines))


def distance_table(distances: Mapping[str, Distances]) -> Table:
    """Points scored by their distance to the survey's."""
    names = ("what", "matched", "mean, cm", "95 %, cm", "largest, cm", "missing", "spurious")
    lines = []
    for name, part in distances.items():
        given = statistics(part.distances_m)
        sizes = centimetre_cells(given.mean, given.percentile_95, given.largest)
        unmatched = map(count_cell, (part.missing, part.spurious))
        lines.append(Line((Cell(name), count_cell(given.count), *sizes, *unmatched)))
    return Table("errors-apart", "Distance to the surveyed place", heads(*names), tuple(lines))


def row_errors(rows: Sequence[Summary]) -> Table:
    """Each scored row's mean absolute error as a bar, its statistics, and what is missing or spurious."""
    scored = [(row, row.score, row.error_m) for row in rows if row.score]
    largest = max((error or 0.0 for _, _, error in scored), default=0.0)
    names = ("row", "'mean absolute error", "cm", "95 %, cm", "count", "'missing", "'spurious")
    lines = []
    for row, score, error in scored:
        given = statistics(all_errors(score))
        bar = Part((error or 0.0) / largest if largest else 0.0, "error", f"{centimetres(error)} cm")
        sizes = centimetre_cells(error, given.percentile_95)
        unmatched = (score.missing, score.spurious)
        cells = (row_cell(row), Cell("", error, bar=(bar,)), *sizes, count_cell(given.count))
        off = any(any(counts.values()) for counts in unmatched)
        lines.append(Line((*cells, *(Cell(named_counts(counts)) for counts in unmatched)), "off" if off else ""))
    return Table("errors-by-row", "Errors by row", heads(*names), tuple(lines))


STAGE_STYLES = 10


def stages(log: RunLog) -> dict[str, float]:
    """Seconds on the clock by stage, over all rows, in the order of the rows' records."""
    total: Counter[str] = Counter()  # of floats here, which it adds as well
    for row in log.rows.values():
        total.update(row.seconds)
    return dict(total)


def stage_styles(log: RunLog) -> dict[str, str]:
    """The style, which is a colour, of each stage."""
    return {name: f"stage-{k % STAGE_STYLES}" for k, name in enumerate(stages(log))}


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
    styles, lines = stage_styles(log), []
    for row, run in ((row, row.run) for row in rows if row.run):
        total = sum(run.seconds.values())
        stages_of_row = run.seconds.items()
        bar = tuple(Part(share / longest, styles[name], f"{name} {duration(share)}") for name, share in stages_of_row)
        cells = (
            row_cell(row),
            Cell(row.status, style=f"badge {row.status}"),
            Cell("", total, bar=bar),
            number_cell(total, 1),
            count_cell(run.used),
            count_cell(run.skipped),
            number_cell(run.peak_mb, 0),
        )
        lines.append(Line(cells, "failed" if row.row is None else "off" if run.skipped else ""))
    return Table("times", "Stages by row", heads(*names), tuple(lines))


def largest_residual(tie: CrossRowMatch) -> float:
    """The largest of its residuals in standard deviations; 0 where none is known."""
    valid = ~np.isnan(tie.residual_m) & ~np.isnan(tie.sigma_m) & (tie.sigma_m > 0)
    return float(np.abs(tie.residual_m[valid] / tie.sigma_m[valid]).max(initial=0.0))


def is_tie_off(tie: CrossRowMatch) -> bool:
    """Whether the two rows contradict each other there."""
    return largest_residual(tie) > OFF_SIGMAS


def tie_hint(tie: CrossRowMatch) -> str:
    """Such as "A: upright 1 = B: upright 9, x +0.4 cm, z -1.0 cm (1.3 sigmas)"."""
    residuals = ", ".join(
        f"{axis} {centimetres(float(value), True)} cm"
        for axis, value in zip("xyz", tie.residual_m, strict=True)
        if not np.isnan(value)
    )
    sigmas = f"{largest_residual(tie):.2f} \u03c3"
    return f"{tie.row_a}: {tie.id_a} = {tie.row_b}: {tie.id_b}, {residuals} ({sigmas})"


def pair_table(ties: Sequence[CrossRowMatch]) -> Table:
    """A line for each two rows that see the same structures."""
    pairs: dict[tuple[str, str], list[CrossRowMatch]] = {}
    for tie in ties:
        pairs.setdefault((tie.row_a, tie.row_b), []).append(tie)
    order = {name: k for k, name in enumerate(natural({name for pair in pairs for name in pair}))}
    names = ("rows", "shared", "root mean square x, cm", "y, cm", "z, cm", "largest, \u03c3", "off by > 3 \u03c3")
    caption = (
        "Rows that see the same things, or share a camera path: what is left between them, along the site\u2019s axes"
    )
    lines = []
    for pair in sorted(pairs, key=lambda pair: (order[pair[0]], order[pair[1]])):
        axes = np.array([tie.residual_m for tie in pairs[pair]]).T
        valid = [values[~np.isnan(values)] for values in axes]
        left = centimetre_cells(*(float(np.sqrt(np.mean(values**2))) if len(values) else None for values in valid))
        off = sum(1 for tie in pairs[pair] if is_tie_off(tie))
        largest = number_cell(max(map(largest_residual, pairs[pair])), 2)
        cells = (Cell(" \u2013 ".join(pair)), count_cell(len(pairs[pair])), *left, largest, count_cell(off))
        lines.append(Line(cells, "off" if off else ""))
    return Table("ties-by-pair", caption, heads(*names), tuple(lines))


def tie_table(ties: Sequence[CrossRowMatch], anchors: Mapping[str, str]) -> Table:
    """A line for each structure that two rows see, the one that they place furthest apart first."""
    names = ("thing", "'in row", "'is", "'in row", "x, cm", "y, cm", "z, cm", "in \u03c3")
    lines = []
    for tie in sorted(ties, key=largest_residual, reverse=True):
        row_a, row_b = (
            Cell(name, link=f"#{anchors[name]}" if name in anchors else "") for name in (tie.row_a, tie.row_b)
        )
        residuals = (*centimetre_cells(*tie.residual_m, plus=True), number_cell(largest_residual(tie), 2))
        lines.append(Line((Cell(tie.id_a), row_a, Cell(tie.id_b), row_b, *residuals), "off" if is_tie_off(tie) else ""))
    caption = "What two rows share: what is left between its two places, along the site\u2019s axes"
    return Table("ties", caption, heads(*names), tuple(lines), "only those off by more than 3 \u03c3")


def alignment_facts(alignment: Alignment) -> tuple[tuple[str, str], ...]:
    """Where the site's origin is in the user's world, and where its x axis points."""
    x, y, turn = (float(sigma) for sigma in np.sqrt(np.diag(alignment.covariance)))
    return (
        ("origin x", f"{fixed(alignment.x_m, 3)} \u00b1 {fixed(x, 3)} m"),
        ("origin y", f"{fixed(alignment.y_m, 3)} \u00b1 {fixed(y, 3)} m"),
        ("origin z", f"{fixed(alignment.z_m, 3)} m"),
        ("heading of the x axis", f"{fixed(alignment.heading_deg, 3)} \u00b1 {fixed(turn, 3)}\u00b0"),
    )


def alignment_table(alignment: Alignment) -> Table:
    """A line for each known place."""
    names = ("place", "'in row", "x, cm", "y, cm", "z, cm", "in \u03c3", "'used")
    lines = []
    for left in alignment.residuals:
        residuals = (*centimetre_cells(*left.residual_m, plus=True), number_cell(left.deviation, 1))
        cells = (Cell(left.at), Cell(left.row), *residuals, Cell("yes" if left.used else "left out"))
        lines.append(Line(cells, "off" if left.deviation > OFF_SIGMAS or not left.used else ""))
    caption = "Known places: given less mapped, along your world\u2019s axes"
    return Table("alignment", caption, heads(*names), tuple(lines))
