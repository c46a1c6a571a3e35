"""From a map to labelled views: data sets to learn from, to choose the best network by, and to measure on.

Beside each view that is learned from stand turned ones; those to choose and to measure by are such as mapping looks at.
"""

import shutil
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import cycle
from pathlib import Path

import numpy as np

from savmap.errors import StructureError
from savmap.lab.adapt.faces import Face, faces_of, outlines_of
from savmap.lab.adapt.masks import IGNORE, Bytes, KnownFace, MaskSettings, mask_of
from savmap.lab.adapt.records import warned_of
from savmap.lab.adapt.views import SeenView, evenly, poses_of, seen_views, turned, views_of
from savmap.lab.label.run import picture_name
from savmap.lab.sim.dataset import write_samples
from savmap.plugin.manager import LoadedPlugin
from savmap.site.job import Job
from savmap.types import RowMap, SiteMap, ViewSpec
from savmap.types.progress import Monitor
from savmap.vision.evidence import gather

VIEWS, CHOICE, HELD_OUT = SETS = "views", "choice", "held-out"
PATTERN = (VIEWS, VIEWS, HELD_OUT, VIEWS, VIEWS, CHOICE, VIEWS, HELD_OUT, VIEWS, VIEWS)
"""Which set each of ten views that follow one another goes to."""
TURNED = 2
"""How many turned views stand beside each that is learned from: they are free, and show the members at other sizes and
angles."""
LEAST_SHOWN = 0.003
"""A view is worth learning from that shows labelled structures in such a share of its pixels."""
LEAST_VIEWS = 28
RENDERER = "the site's own views"

Labelled = tuple[str, Bytes, Bytes]
"""A view's name, its picture (h, w, 3) RGB and its labels (h, w)."""
Shares = Mapping[tuple[int, ViewSpec], str]
"""Which set a view of a frame goes to."""


@dataclass(frozen=True)
class LabelSets:
    """The data sets of a round: the views to learn from, those to choose the best network by, and those that are held
    out."""

    views: Path
    choice: Path
    held_out: Path


def write_labels(job: Job, plugin: str, site_map: SiteMap, count: int, folder: Path, monitor: Monitor) -> LabelSets:
    """Write at most `count` views, labelled by a map, into data sets in a folder, unless they are there.

    Raises StructureError where too few of them show anything."""
    sets = LabelSets(*(folder / name for name in SETS))
    if all((folder / name).is_dir() for name in SETS):
        return sets
    classes = job.opened(next(iter(job.site.rows)), plugin).classes
    shared = list(labelled_views(job, plugin, site_map, count, monitor))
    labelled = [view for _, view in shared]
    if len(labelled) < LEAST_VIEWS:
        raise StructureError(
            f"{job.source}: the map labels {len(labelled)} views, fewer than {LEAST_VIEWS}: too few to learn from; map "
            "more of the site, or label some by hand (`savmap label`)"
        )
    for name in SETS:
        write_set(folder / name, classes, [view for goes_to, view in shared if goes_to == name])
    return sets


def labelled_views(
    job: Job, plugin: str, site_map: SiteMap, count: int, monitor: Monitor
) -> Iterator[tuple[str, Labelled]]:
    """Views of all rows of a map with what it labels in them, and the set that each goes to; those in which that is
    next to nothing are left out. `count` is without the turned ones."""
    rows = {name: row for name, row in site_map.rows.items() if name in job.site.rows and row.structures.get(plugin)}
    loaded = {name: job.opened(name, plugin) for name in rows}
    outlines = {
        name: outlines_of(row.structures[plugin], loaded[name].classes, warned_of(row)) for name, row in rows.items()
    }
    candidates = {name: views_of(row, outlines[name]) for name, row in rows.items()}
    total, pattern = sum(map(len, candidates.values())), cycle(PATTERN)
    for name, row in rows.items():
        chosen = evenly(candidates[name], round(count * len(candidates[name]) / total) if total else 0)
        shares = _shares(chosen, pattern)
        by_frame = {frame: [spec for of, spec in shares if of == frame] for frame in chosen}
        seen = list(seen_views(row, job.site.rows[name].passes, loaded[name], by_frame, monitor))
        yield from _labelled(row, faces_of(outlines[name]), seen, loaded[name], shares)


def _shares(chosen: Mapping[int, Sequence[ViewSpec]], pattern: Iterator[str]) -> Shares:
    """The sets of the chosen views, and of the turned ones beside each that is learned from."""
    sets = {(frame, spec): next(pattern) for frame, specs in chosen.items() for spec in specs}
    learned = [view for view, name in sets.items() if name == VIEWS]
    turned_views = {(frame, turned(spec, frame, number)): VIEWS for frame, spec in learned for number in range(TURNED)}
    return sets | turned_views


def _labelled(
    row: RowMap, faces: Sequence[Face], seen: Sequence[SeenView], plugin: LoadedPlugin, shares: Shares
) -> Iterator[tuple[str, Labelled]]:
    if not seen:
        return
    mapped = {*row.views.values()}
    packed_views, classes = [view.packed_view for view in seen if view.spec in mapped], seen[0].classes
    known_faces = [
        KnownFace.of(face, gather(face.patch, classes, packed_views, row.views, row.trajectory)) for face in faces
    ]
    poses, settings = poses_of(row), MaskSettings()
    for view in seen:
        mask = mask_of(view.packed_view, view.spec, poses[view.frame], known_faces, plugin.classes, settings)
        if np.mean((mask > 0) & (mask != IGNORE)) >= LEAST_SHOWN:
            yield (
                shares[view.frame, view.spec],
                (picture_name(row.name, view.spec.name, view.frame), view.picture, mask),
            )


def write_set(folder: Path, classes: Sequence[str], labelled: Iterable[Labelled]) -> None:
    """Write labelled views as a data set, all of it or nothing. Raises OutputError."""
    partial = folder.with_name(f"{folder.name}.part")
    for place in (folder, partial):
        shutil.rmtree(place, ignore_errors=True)
    write_samples(partial, classes, RENDERER, labelled)
    partial.rename(folder)
