"""Are the standard deviations of maps of footage true? Normalised errors (estimate - truth) / sigma, class by class.

    python -m bench sigmas SITE ... [--keep DIR]

Maps the first row of each site that has a survey. By class of figure: the errors' root mean square, mm, the usual sigma, mm, and the normalised
errors' root mean square, which should be 0.7 to 1.4. What was measured in the pictures is kept in DIR, and used again there.
"""

import argparse
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from bench.baseline import Figures
from savmap.errors import SavmapError
from savmap.files.atomic import write_bytes
from savmap.files.journal import Journal
from savmap.files.serialization import packed, unpacked
from savmap.jobs.tasks import request_for
from savmap.maps.survey import read_survey
from savmap.pipeline.records import MeasuredRow, RowMeasurements
from savmap.pipeline.row import map_rows, measure
from savmap.site.job import job_for
from savmap.types import Floats, RowMap, Structure
from savmap.types.progress import NoteCollector
from savmap_shelves.mapping import Elements, sections_of, uprights_of

UPRIGHT_M, BEAM_M, LAMP_M = 0.5, 0.15, 1.0
KINDS = ("upright x", "upright width", "beam y", "beam height", "lamp x", "lamp y", "lamp z")
BY_CONVENTION_M = 1e-3
Figure = tuple[str, float, float]
"""Kind, error and sigma, both m."""


def mapped(site: Path, keep: Path) -> tuple[RowMap, Mapping[str, Any]]:
    """The map of a site's first row, and its truth. Raises SavmapError."""
    job = job_for(site, None, site.parent)
    name = next(iter(job.site.rows))
    assert job.site.survey is not None
    request, monitor = request_for(job, name), NoteCollector()
    kept = keep / f"{site.absolute().parent.name}.measured"
    if kept.is_file():
        measurements = unpacked(kept.read_bytes(), RowMeasurements)
    else:
        (measured,) = measure([request], Journal(), monitor)
        if isinstance(measured, SavmapError):
            raise measured
        measurements = measured.measurements
        write_bytes(kept, packed(measurements))
    row = map_rows([MeasuredRow(request, measurements)], monitor)[0]
    if isinstance(row, SavmapError):
        raise row
    return row, read_survey(job.site.survey).rows[name]


def figures_of(row: RowMap, survey: Mapping[str, Any]) -> Iterator[Figure]:
    """All that the map says with a sigma and the survey says too, of elements that both have."""
    structures = row.structures.get("shelves", ())
    by_id = {structure.id: structure for structure in structures}
    yield from _of_elements(
        uprights_of(structures), by_id, np.array(survey["uprights"]), KINDS[:2], ("left", "right"), UPRIGHT_M
    )
    bays = np.array(survey["uprights"]).mean(axis=1)
    for section in sections_of(structures):
        number = int(np.searchsorted(bays, section.extent.mean())) - 1
        if 0 <= number < len(survey["sections"]):
            truth = np.array(survey["sections"][number]["beams"])
            yield from _of_elements(section.beams, by_id, truth, KINDS[2:4], ("lower", "upper"), BEAM_M)
    ends = np.array([lamp["ends"] for lamp in survey.get("lights", [])]).reshape(-1, 2, 3)
    yield from _of_lamps(row.structures.get("lights", ()), ends.mean(axis=1))


def _of_elements(
    found: Elements,
    by_id: Mapping[str, Structure],
    truth: Floats,
    kinds: Sequence[str],
    sides: tuple[str, str],
    gate_m: float,
) -> Iterator[Figure]:
    """Edges and widths of elements (n, 2) that are near surveyed ones (m, 2)."""
    axis, size = (0, "width_sigma_m") if sides[0] == "left" else (1, "height_sigma_m")
    for name, interval in zip(found.ids, found.intervals, strict=True):
        near = truth[np.argmin(np.abs(truth.mean(axis=1) - interval.mean()))] if len(truth) else interval + np.inf
        if abs(near.mean() - interval.mean()) > gate_m:
            continue
        structure = by_id[name]
        for side, estimate, true in zip(sides, interval, near, strict=True):
            at = next(k for k, label in enumerate(structure.vertex_labels) if side in label.split())
            sigma = float(np.sqrt(structure.covariances[at, axis, axis]))
            if sigma > BY_CONVENTION_M / 2:
                yield kinds[0], float(estimate - true), sigma
        yield kinds[1], float(np.diff(interval)[0] - np.diff(near)[0]), float(structure.attributes[size])


def _of_lamps(found: Sequence[Structure], truth: Floats) -> Iterator[Figure]:
    """Lamps' centres, whose ends' errors are taken for common to both."""
    for lamp in found:
        centre, variances = lamp.vertices.mean(axis=0), np.diagonal(lamp.covariances, axis1=1, axis2=2).mean(axis=0)
        apart = np.linalg.norm(truth - centre, axis=1)
        if len(apart) and apart.min() < LAMP_M:
            errors = centre - truth[int(np.argmin(apart))]
            yield from zip(KINDS[-3:], errors.tolist(), np.sqrt(variances).tolist(), strict=True)


def by_kind(found: Sequence[Figure]) -> dict[str, dict[str, float]]:
    """Count, root mean square error and usual sigma, mm, and normalised errors' root mean square of each class."""
    table: dict[str, dict[str, float]] = {}
    for kind in KINDS:
        pairs = np.array([(error, sigma) for other, error, sigma in found if other == kind])
        if len(pairs):
            rms = float(np.sqrt(np.mean(pairs[:, 0] ** 2)))
            spread = float(np.sqrt(np.mean((pairs[:, 0] / pairs[:, 1]) ** 2)))
            sigma = float(np.median(pairs[:, 1]))
            table[kind] = {"count": len(pairs), "error mm": 1e3 * rms, "sigma mm": 1e3 * sigma, "error / sigma": spread}
    return table


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of this bench."""
    parser.add_argument("sites", nargs="+", type=Path)


def run(given: argparse.Namespace) -> Figures:
    """Figures over all sites together."""
    every: list[Figure] = []
    for site in given.sites:
        try:
            row, survey = mapped(site, given.keep)
        except SavmapError as error:
            print(f"{site}: {error}"[:140], flush=True)
            continue
        every += figures_of(row, survey)
    return by_kind(every)
