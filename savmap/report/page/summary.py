"""What a report is made from, and a summary of each row: its state, how much was mapped, and what of it deserves
attention."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import chain

import numpy as np

from savmap.maps.run_record import RowRun, RunLog
from savmap.plugin.apps import Changes
from savmap.report.evaluation import mean_absolute_error, named_counts
from savmap.report.numbers import anchors, natural
from savmap.report.row_views import label_counts
from savmap.types import (
    Drawing,
    Evaluation,
    MapWarning,
    Orthophoto,
    Placement,
    ReferenceUse,
    RowMap,
    Score,
    SiteMap,
    Still,
    Structure,
)

OFF = ("contradicted", "left out")
"""The states of references that the solution contradicts."""


@dataclass(frozen=True, eq=False)
class Report:
    """A map, what the plugins draw of each row, by name, and, where there are any, the run that made it, its scores
    against a survey, remarks for the reader, orthophotos and stills of rows by name, the name of the viewer's page
    beside this one, and what changed since an earlier map. `places`: by row and plugin, places between structures that
    have a name and sizes."""

    site_map: SiteMap
    drawings: Mapping[str, Sequence[Drawing]]
    log: RunLog | None = None
    evaluation: Evaluation | None = None
    remarks: tuple[str, ...] = ()
    title: str = "Site map"
    photos: Mapping[str, Orthophoto] = field(default_factory=dict)
    viewer: str = ""
    stills: Mapping[str, Sequence[Still]] = field(default_factory=dict)
    changes: Changes | None = None
    places: Mapping[str, Mapping[str, Sequence[Structure]]] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Summary:
    """One row of the site. `status`: mapped, kept or failed; `error`: why it failed; `row`: its map, if there is one;
    `place`: where it stands in the site's frame, where that is known; `photo`: its orthophoto, if there is one;
    `stills`: panoramas of its frames; `places`: those between its structures."""

    name: str
    anchor: str
    status: str
    error: str
    row: RowMap | None
    drawings: tuple[Drawing, ...]
    score: Score | None
    run: RowRun | None
    place: Placement | None = None
    photo: Orthophoto | None = None
    stills: tuple[Still, ...] = ()
    places: tuple[Structure, ...] = ()

    @property
    def counts(self) -> dict[str, int]:
        """Structures by label."""
        return label_counts(self.row) if self.row else {}

    @property
    def length_m(self) -> float | None:
        """How far the structure that bounds the row's pictures reaches along x; None where nothing of it is drawn."""
        structure = [shape for shape in self.drawings if shape.tone == "structure" and shape.role != "survey"]
        return float(np.ptp(np.concatenate([shape.points[:, 0] for shape in structure]))) if structure else None

    @property
    def references(self) -> tuple[ReferenceUse, ...]:
        """References of the row's solve."""
        return self.row.references if self.row else ()

    @property
    def references_off(self) -> int:
        """How many references the solution contradicts, used or not."""
        return sum(1 for reference in self.references if reference.state in OFF)

    @property
    def error_m(self) -> float | None:
        """Mean absolute error against the survey."""
        return mean_absolute_error(self.score) if self.score else None

    @property
    def warnings(self) -> tuple[MapWarning, ...]:
        """What speaks against the row's map."""
        return self.row.verdict.warnings if self.row and self.row.verdict else ()

    @property
    def notes(self) -> tuple[str, ...]:
        """What the verdict rests on that nothing checks."""
        return self.row.verdict.notes if self.row and self.row.verdict else ()

    @property
    def remarks(self) -> tuple[str, ...]:
        """What of a mapped row deserves attention."""
        off, skipped = self.references_off, self.run.skipped if self.run else 0
        counts = (self.score.missing, self.score.spurious) if self.score else ({}, {})
        missing, spurious = (named_counts(part) for part in counts)
        remarks = (
            (
                self.warnings,
                f"to be checked: {len(self.warnings)} {'warnings' if len(self.warnings) > 1 else 'warning'}",
            ),
            (off, f"{off} {'references' if off > 1 else 'reference'} contradicted"),
            (missing != "none", f"missing: {missing}"),
            (spurious != "none", f"spurious: {spurious}"),
            (skipped, f"{skipped} frames skipped"),
        )
        return tuple(text for applies, text in remarks if applies)


def summaries(report: Report) -> tuple[Summary, ...]:
    """All rows that the map or the run knows of: those that failed first, then in the order in which people count."""
    site, runs = report.site_map, report.log.rows if report.log else {}
    failed = {name: run.error for name, run in runs.items() if run.status == "failed" and name not in site.rows}
    errors = {**failed, **{name: text for name, text in site.failed.items() if name not in site.rows}}
    mapped = {name: runs[name].status if name in runs else "mapped" for name in site.rows}
    names = [*natural(errors), *natural(mapped)]
    ids = anchors(names)
    scores = report.evaluation.rows if report.evaluation else {}
    return tuple(
        Summary(
            name=name,
            anchor=ids[name],
            status="failed" if name in errors else mapped[name].replace("failed", "kept"),
            error=errors.get(name, ""),
            row=site.rows.get(name),
            drawings=tuple(report.drawings.get(name, ())),
            score=scores.get(name),
            run=runs.get(name),
            place=site.placements.get(name),
            photo=report.photos.get(name),
            stills=tuple(report.stills.get(name, ())),
            places=tuple(chain.from_iterable(report.places.get(name, {}).values())),
        )
        for name in names
    )


def total_counts(rows: Sequence[Summary]) -> dict[str, int]:
    """Structures of all rows by label."""
    total: Counter[str] = Counter()
    for row in rows:
        total.update(row.counts)
    return dict(total)
