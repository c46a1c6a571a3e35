"""What `savmap adapt` is asked to do, and what it did."""

from collections.abc import Collection, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any, Protocol

from savmap.errors import SiteError
from savmap.files.atomic import sha256
from savmap.lab.train.plan import Progress
from savmap.site.job import Job
from savmap.types import RowMap, SiteMap

ROUNDS, VIEWS, PRACTICE = 2, 150, 60


class Meter(Protocol):
    """Shows how far something is: a context that gives a function for the share done (0..1) and a line."""

    def __call__(self, doing: str) -> AbstractContextManager[Progress]: ...


@dataclass(frozen=True)
class AdaptOptions:
    """The command's options: whose network, which rows (none: all), at most how many rounds, the minutes or steps of
    training in each, data sets of other places, from how many views at most, with how many pictures that the plugin
    makes itself, and how many rows are mapped at a time (None: as fits)."""

    plugin: str | None = None
    rows: Sequence[str] = ()
    rounds: int = ROUNDS
    minutes: float | None = None
    steps: int | None = None
    replay: Sequence[Path] = ()
    views: int = VIEWS
    practice: int = PRACTICE
    jobs: int | None = None

    def __post_init__(self) -> None:
        if self.rounds < 1:
            raise SiteError(f"--rounds {self.rounds}: give 1 or more")


@dataclass(frozen=True, eq=False)
class State:
    """A network and the map that was made with it: the file of the network that is used, the one in float32 that is
    trained on, the map's file, and the map."""

    model: Path
    trainable: Path
    map_file: Path
    site_map: SiteMap

    def structures(self, plugin: str, classes: Sequence[str]) -> int:
        """How many structures of the network's classes the map has."""
        rows = self.site_map.rows.values()
        return sum(structure.label in classes for row in rows for structure in row.structures.get(plugin, ()))

    def sound(self, plugin: str, classes: Sequence[str]) -> int:
        """How many of these no warning of their row's verdict names."""
        return sum(_sound(row, plugin, classes) for row in self.site_map.rows.values())

    @property
    def digest(self) -> str:
        """A digest of the network and the map."""
        return sha256(self.trainable) + sha256(self.map_file)


def _sound(row: RowMap, plugin: str, classes: Sequence[str]) -> int:
    warned = warned_of(row)
    return sum(
        structure.label in classes and structure.id not in warned for structure in row.structures.get(plugin, ())
    )


def warned_of(row: RowMap) -> frozenset[str]:
    """The ids of the structures that a warning of a row's verdict names."""
    return frozenset(name for warning in (row.verdict.warnings if row.verdict else ()) for name in warning.subjects)


@dataclass(frozen=True)
class RoundResult:
    """What came of a round: how many views were learned from and held out, the network's intersection over union with
    the map on the latter by class, before and after, the map's structures before and after (None: it was not mapped
    again), why it was kept or not, and intersection over union on pictures of other places, before and after (none
    where there are no such pictures)."""

    number: int
    views: int
    held_out: int
    iou_before: Mapping[str, float]
    iou_after: Mapping[str, float]
    structures_before: int
    structures_after: int | None
    kept: bool
    why: str
    others_before: Mapping[str, float] = field(default_factory=dict)
    others_after: Mapping[str, float] = field(default_factory=dict)

    def as_json(self) -> dict[str, Any]:
        """For the report."""
        return asdict(self)


def mean(iou: Mapping[str, float]) -> float:
    """The mean of the classes' intersections over union."""
    return sum(iou.values()) / max(len(iou), 1)


@dataclass(frozen=True, eq=False)
class Adapted:
    """What came of it all: the rounds, the network's files and the map's (none where no round was kept), intersection
    over union by class on views held out, and structures, before and after."""

    plugin: str
    rounds: tuple[RoundResult, ...]
    files: tuple[Path, ...]
    iou_before: Mapping[str, float]
    iou_after: Mapping[str, float]
    structures_before: int
    structures_after: int
    report: Path

    @property
    def others(self) -> tuple[Mapping[str, float], Mapping[str, float]]:
        """Intersection over union by class on pictures of other places, of the first network and of the last that is
        kept."""
        before = self.rounds[0].others_before
        return before, self.kept.others_after if self.kept else before

    @property
    def kept(self) -> RoundResult | None:
        """The last round that was kept."""
        return next((result for result in reversed(self.rounds) if result.kept), None)

    def as_json(self) -> dict[str, Any]:
        """For report.json."""
        return {
            "format": "savmap-adapted",
            "version": 1,
            "plugin": self.plugin,
            "kept round": self.kept.number if self.kept else None,
            "files": [file.name for file in self.files],
            "iou": {"before": dict(self.iou_before), "after": dict(self.iou_after)},
            "other places": dict(zip(("before", "after"), map(dict, self.others), strict=True)),
            "structures": {"before": self.structures_before, "after": self.structures_after},
            "rounds": [result.as_json() for result in self.rounds],
        }


def job_of_rows(job: Job, names: Sequence[str]) -> Job:
    """The job with some of its rows alone; all where none are named. Raises SiteError for one that is not there."""
    unknown = [name for name in names if name not in job.site.rows]
    if unknown:
        raise SiteError(f"--row {unknown[0]}: there is no such row; rows are {', '.join(job.site.rows)}")
    rows = {name: row for name, row in job.site.rows.items() if not names or name in names}
    return _changed(job, rows=rows)


def job_with_network(job: Job, plugin: str, model: Path) -> Job:
    """The job with another network of a plugin in all rows."""
    set_for = {"model": str(model.resolve())}
    rows = {
        name: row.model_copy(update={"plugins": {**row.plugins, plugin: {**row.plugins.get(plugin, {}), **set_for}}})
        for name, row in job.site.rows.items()
    }
    return _changed(job, rows=rows)


def job_without_lengths(job: Job, names: Collection[str]) -> Job:
    """The job with no distances between named structures, nor their coordinates, in some of its rows: a map may lack
    one of these."""
    rows = {
        name: row.model_copy(update={"references": row.references.model_copy(update={"lengths": (), "points": ()})})
        if name in names
        else row
        for name, row in job.site.rows.items()
    }
    return _changed(job, rows=rows)


def _changed(job: Job, **update: Any) -> Job:
    """A new job: one that differs must not be taken for the old one in another process."""
    new = replace(job, site=job.site.model_copy(update=update))
    return Job(new.site, new.source, new.plugins, new.output, new.earlier, new.places, new.notes)
