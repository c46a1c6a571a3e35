"""docs/accuracy.md, made of stored results: a table a claim."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from bench.baseline import Figures, Result, cells_of

PAGE = Path(__file__).parents[1] / "docs" / "accuracy.md"


@dataclass(frozen=True)
class Claim:
    """A heading, what to know of its table, and the results in it. Of several results, each row is called by `labels`, by the result's name."""

    heading: str
    text: str
    results: Sequence[str]
    labels: Mapping[str, str] = field(default_factory=dict)
    columns: Sequence[str] = ()


TEST_ROWS = "rows, --set test --family rows 'grey rows' 'dark rows' --count 4 --row both"
WITHOUT = {
    f"{TEST_ROWS} --without 'shared levels'": "test, without shared levels",
}
"""The ablation: terms of the face's model that were switched off."""
DEVELOPMENT_ROWS = "rows, --count 9 --row both"
CLAIMS = (
    Claim(
        "Made-up rows from footage to map",
        "Random rows of 40 frames at 2048x1024, both faces where the drive goes past all of them. Test: twelve drives that nobody had looked at, four of "
        "them grey and four dark. Development: nine drives whose faults were looked at. Good: racks and lamps whole, within 1 cm. Of all that is found "
        "with P(exists) above 0.99, more than 99.5 % exist.",
        (TEST_ROWS, *WITHOUT, DEVELOPMENT_ROWS),
        {TEST_ROWS: "test", **WITHOUT, DEVELOPMENT_ROWS: "development"},
    ),
    Claim(
        "A long row",
        "Three bays repeated six times: 58 m, 240 frames, 19 uprights, 96 beams. Nothing is missing or invented.",
        ("long row",),
    ),
    Claim(
        "The published error is bias",
        "Masks' edges lie outside the structure ([SAVMap], section IV.B). A bias of 1.1 px, 2 cm on a face 1.5 m away, explains the published error. "
        "46 rows of 15 bays at observation level have that bias, 0.7 px of noise, the four mask errors and 5 % outliers; the shares are a guess. Both "
        "methods get the same tracks and references. Two widths measured with a tape make the bias observable.",
        ("published error",),
    ),
    Claim(
        "The same rows as a site",
        "Places are given to 20 cm and half a degree; errors are root mean squares. First and last: a fifth of the rows.",
        ("site46, --jobs 2",),
    ),
    Claim(
        "What each part buys",
        "Two rows of three bays at observation level: additions to the published method, and the Cramer-Rao bound. Robust loss, rejection and the "
        "linear start map rows that would be refused.",
        ("what each part buys",),
    ),
    Claim(
        "On footage, by the size of the panorama",
        "`examples/scenes/precise-row.yaml`, three bays, and the demo. Nothing is missing or spurious. Errors below the bound are luck: the setback "
        "equals the mean of its prior.",
        ("edges by panorama size",),
    ),
    Claim(
        "Photographs on a plane",
        "Rows whose face is a rectified photograph, in colour, in grey and at a third of the light. Parallax is missing. Good: nothing missing or "
        "spurious, at most 1.5 cm. All others are refused or `check`: `wire-decks`, whose lowest beam is taken 5 cm too low, `wood-totes`, and "
        "`grey-cartons` in colour and grey, where a beam is seen on the floor.",
        ("photo-rows",),
    ),
    Claim(
        "Standard deviations",
        "Normalised errors at observation level: root mean square (1 is right), share within 1.96. Uprights share the row's length: 16 rows are 16 "
        "samples.",
        ("sigmas without pictures",),
    ),
    Claim(
        "Standard deviations on footage",
        "The 2.21 is of a few beams, measured 4 to 5 cm off in most frames. The demo's lamps hang 1.8 cm off at sigmas of 2.4 mm.",
        ("sigmas, rows 5000 to 5019 and a grey one", "sigmas, twelve rows of photographs", "sigmas, demo"),
    ),
    Claim(
        "Where the beams stand",
        "Beams stand 0 to 2 cm behind the uprights, which looks like a lower rack. The setback comes from its prior (5 mm +- 1 cm, `beam_setback_m`), a "
        "vertical length, or labels and stains on the beams ([method](method.md#how-deep-flat-parts-lie)): in 15 of twenty rows, to 0.6 mm.",
        ("setback",),
    ),
    Claim(
        "A camera that is off",
        "Errors without and with each term of `calibration`, then of the parameters. Turns are observable with the seam in the face's view. "
        "Rendered pictures give less: take the parameters as a sign.",
        ("a camera that is off",),
    ),
    Claim(
        "Both faces of an aisle",
        "Row A has a length; row B, on the other side of the drive, has heights only.",
        ("both faces of an aisle",),
    ),
    Claim(
        "Appearance",
        "Points of no structure (`appearance: true`): a tenth of a millimetre along x for 18 % of processor time.",
        ("appearance",),
    ),
    Claim(
        "Peers",
        "pycolmap 4.2.1 on the same views. Positions: ours after rotation and translation, the peer's after seven parameters; on the demo against ours.",
        ("positions beside pycolmap",),
    ),
    Claim(
        "Wrong input",
        "Wrong references and clips, 64 ways on four rows ([verdict](verdict.md)). Uncheckable: the map says that such an error would stay hidden.",
        ("physics, rows demo 5003 7101 7102",),
    ),
)
HEAD = """# Accuracy

Made of stored results by `python -m bench write-docs`. Errors are mean absolute errors of widths and gaps, unless said otherwise. V: uprights, H: beams.
Machines were shared. More figures: [signs](signs.md#what-to-expect), [recordings](split.md#accuracy), [changes](howto/compare.md#how-well-it-works),
[photographs](photographs.md#figures), [adapting](adapting.md), [time](method.md#measured).
"""


def page(results: Mapping[str, Result]) -> str:
    """The text of the page."""
    sections = [f"## {claim.heading}\n\n{claim.text}\n\n{_tables(claim, results)}" for claim in CLAIMS]
    return HEAD + "\n" + "\n\n".join(sections) + "\n\n[SAVMap]: method.md#savmap\n"


def _tables(claim: Claim, results: Mapping[str, Result]) -> str:
    """The totals of several results are one table; of other rows, those that share no column with those before begin another table."""
    chosen = {name: results[name] for name in claim.results}
    rows: dict[str, Mapping[str, float]] = {}
    for name, result in chosen.items():
        for row, cells in result.figures.items():
            called = f"{name.partition(', ')[2]}, {row}" if len(chosen) > 1 else row
            rows[claim.labels.get(name, called)] = cells
    tables: list[dict[str, Mapping[str, float]]] = [{}]
    for row, cells in rows.items():
        if tables[-1] and not any(cells.keys() & others.keys() for others in tables[-1].values()):
            tables.append({})
        tables[-1][row] = cells
    date = max(result.date for result in chosen.values())
    return "\n\n".join([*map(_markdown, tables), f"{_source(claim, chosen)}, {date}."])


def _markdown(table: Figures) -> str:
    head, *lines = cells_of(table)
    return "\n".join(f"|{'|'.join(row)}|" for row in (head, ["---"] * len(head), *lines))


def _source(claim: Claim, chosen: Mapping[str, Result]) -> str:
    """The result's name, or the script of an earlier revision that measured it."""
    first = next(iter(chosen.values()))
    if first.revision and first.settings.startswith("bench/"):
        return f"{first.settings} at revision {first.revision}"
    return f"`{claim.results[0]}`"
