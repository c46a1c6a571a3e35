"""What there is to say of each row: its state, how much was mapped, and what of it deserves a look."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from savmap.evaluation import Evaluation, Score, mean_absolute_error
from savmap.report.drawing import Drawing
from savmap.report.page.numbers import anchors, counted, natural
from savmap.types import Placement, ReferenceUse, RowMap, SiteMap

if TYPE_CHECKING:
    from savmap.maps.run_record import RowRun, RunLog

OFF_SIGMAS = 3.0


@dataclass(frozen=True)
class Summary:
    """One row of the site. `status`: mapped, kept or failed; `error`: why it failed; `row`: its map, if there is one; `place`:
    where it stands in the site's frame, where that is known."""

    name: str
    anchor: str
    status: str
    error: str
    row: RowMap | None
    drawings: tuple[Drawing, ...]
    score: Score | None
    run: "RowRun | None"
    place: Placement | None = None

    @property
    def counts(self) -> dict[str, int]:
        """Structures by label."""
        every = self.row.structures.values() if self.row else ()
        return dict(Counter(own.label for structures in every for own in structures))

    @property
    def length_m(self) -> float | None:
        """How far the structure that bounds the row's pictures reaches along x; None where nothing of it is drawn."""
        bounding = [own.points[:, 0] for own in self.drawings if own.tone == "structure" and own.role != "survey"]
        return float(np.ptp(np.concatenate(bounding))) if bounding else None

    @property
    def references(self) -> tuple[ReferenceUse, ...]:
        """References of the row's solve."""
        return self.row.references if self.row else ()

    @property
    def error_m(self) -> float | None:
        """Mean absolute error against the survey."""
        return mean_absolute_error(self.score) if self.score else None

    @property
    def remarks(self) -> tuple[str, ...]:
        """What of a mapped row deserves a look."""
        off = sum(1 for own in self.references if is_off(own))
        missing, spurious = (
            counted(own) for own in ((self.score.missing, self.score.spurious) if self.score else ({}, {}))
        )
        found = (
            (off, f"{off} {'references' if off > 1 else 'reference'} off by more than {OFF_SIGMAS:g} \u03c3"),
            (missing != "none", f"missing: {missing}"),
            (spurious != "none", f"spurious: {spurious}"),
            (self.run and self.run.skipped, f"{self.run.skipped if self.run else 0} frames skipped"),
        )
        return tuple(text for given, text in found if given)


def summaries(
    site: SiteMap, drawings: Mapping[str, Sequence[Drawing]], log: "RunLog | None", evaluation: Evaluation | None
) -> tuple[Summary, ...]:
    """All rows that the map or the run knows of: those that failed first, then in the order in which people count."""
    runs = log.rows if log else {}
    failed = {name: run.error for name, run in runs.items() if run.status == "failed" and name not in site.rows}
    errors = {**failed, **{name: text for name, text in site.failed.items() if name not in site.rows}}
    mapped = {name: runs[name].status if name in runs else "mapped" for name in site.rows}
    names = [*natural(errors), *natural(mapped)]
    ids = anchors(names)
    scores = evaluation.rows if evaluation else {}
    return tuple(
        Summary(
            name=name,
            anchor=ids[name],
            status="failed" if name in errors else mapped[name].replace("failed", "kept"),
            error=errors.get(name, ""),
            row=site.rows.get(name),
            drawings=tuple(drawings.get(name, ())),
            score=scores.get(name),
            run=runs.get(name),
            place=site.placements.get(name),
        )
        for name in names
    )


def in_sigmas(own: ReferenceUse) -> float:
    """A reference's residual, solved - given, in its standard deviations."""
    return (own.solved - own.value) / own.sigma


def is_off(own: ReferenceUse) -> bool:
    """Whether the solution contradicts a reference."""
    return abs(in_sigmas(own)) > OFF_SIGMAS


def all_counts(rows: Sequence[Summary]) -> dict[str, int]:
    """Structures of all rows by label."""
    total: Counter[str] = Counter()
    for row in rows:
        total.update(row.counts)
    return dict(total)
