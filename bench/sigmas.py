"""Are the standard deviations of maps of footage true? Normalised errors (estimate - truth) / sigma, class by class.

    python bench/sigmas.py SITE ... [--keep DIR] [-o bench/results/sigmas.json]

Maps the first row of each site that has a survey. Printed, by class of figure: the errors' root mean square, mm, the usual sigma, mm, and
the normalised errors' root mean square, which should be 0.7 to 1.4; and by how much the pictures' variances were inflated. What was measured
in the pictures is kept in DIR, and used again there.
"""

import argparse
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from savmap.errors import SavmapError
from savmap.files.atomic import write_bytes, write_text
from savmap.files.serialization import packed, unpacked
from savmap.jobs.tasks import request_for
from savmap.maps.survey import read_survey
from savmap.pipeline.records import RowMeasurements
from savmap.pipeline.row import map_rows, measure
from savmap.site.job import job_for
from savmap.types import Floats, RowMap, Structure
from savmap.types.progress import NoteCollector
from savmap_shelves.mapping import Elements, sections_of, uprights_of

ROOT = Path(__file__).parent.parent
UPRIGHT_M, BEAM_M, LAMP_M = 0.5, 0.15, 1.0
KINDS = ("upright x", "upright width", "beam y", "beam height", "lamp x", "lamp y", "lamp z")
BY_CONVENTION_M = 1e-3
Figure = tuple[str, float, float]
"""Kind, error and sigma, both m."""
NamedFigure = tuple[str, Figure]


def mapped(site: Path, keep: Path | None) -> tuple[RowMap, Mapping[str, Any]]:
    """The map of a site's first row, and its truth. Raises SavmapError."""
    job = job_for(site, None, site.parent)
    name = next(iter(job.site.rows))
    assert job.site.survey is not None
    request, monitor = request_for(job, name), NoteCollector()
    kept = keep / f"{site.absolute().parent.name}.measured" if keep else None
    if kept is not None and kept.is_file():
        measurements = unpacked(kept.read_bytes(), RowMeasurements)
    else:
        measurements = measure(request, monitor).measurements
        if kept is not None:
            write_bytes(kept, packed(measurements))
    row = map_rows([replace(request, measurements=measurements)], monitor)[0]
    if isinstance(row, SavmapError):
        raise row
    return row, read_survey(job.site.survey).rows[name]


def figures(row: RowMap, survey: Mapping[str, Any]) -> Iterator[Figure]:
    """All that the map says with a sigma and the survey says too, of elements that both have."""
    yield from (figure for _, figure in figures_of(row, survey))


def figures_of(row: RowMap, survey: Mapping[str, Any]) -> Iterator[NamedFigure]:
    """The same, each with the id of its element."""
    structures = row.structures.get("shelves", ())
    by_id = {structure.id: structure for structure in structures}
    yield from _of_uprights(uprights_of(structures), by_id, np.array(survey["uprights"]))
    bays = np.array(survey["uprights"]).mean(axis=1)
    for section in sections_of(structures):
        number = int(np.searchsorted(bays, section.extent.mean())) - 1
        if 0 <= number < len(survey["sections"]):
            yield from _of_beams(section.beams, by_id, np.array(survey["sections"][number]["beams"]))
    ends = np.array([lamp["ends"] for lamp in survey.get("lights", [])]).reshape(-1, 2, 3)
    yield from _of_lamps(row.structures.get("lights", ()), ends.mean(axis=1))


def _of_uprights(found: Elements, by_id: Mapping[str, Structure], truth: Floats) -> Iterator[NamedFigure]:
    yield from _of_elements(found, by_id, truth, ("upright x", "upright width"), ("left", "right"), UPRIGHT_M)


def _of_beams(found: Elements, by_id: Mapping[str, Structure], truth: Floats) -> Iterator[NamedFigure]:
    yield from _of_elements(found, by_id, truth, ("beam y", "beam height"), ("lower", "upper"), BEAM_M)


def _of_elements(
    found: Elements,
    by_id: Mapping[str, Structure],
    truth: Floats,
    kinds: tuple[str, str],
    sides: tuple[str, str],
    gate_m: float,
) -> Iterator[NamedFigure]:
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
                yield name, (kinds[0], float(estimate - true), sigma)
        yield name, (kinds[1], float(np.diff(interval)[0] - np.diff(near)[0]), float(structure.attributes[size]))


def _of_lamps(found: Sequence[Structure], truth: Floats) -> Iterator[NamedFigure]:
    """Lamps' centres, whose ends' errors are taken for common to both."""
    for lamp in found:
        centre, variances = lamp.vertices.mean(axis=0), np.diagonal(lamp.covariances, axis1=1, axis2=2).mean(axis=0)
        apart = np.linalg.norm(truth - centre, axis=1)
        if len(apart) and apart.min() < LAMP_M:
            errors = centre - truth[int(np.argmin(apart))]
            for figure in zip(KINDS[-3:], errors.tolist(), np.sqrt(variances).tolist(), strict=True):
                yield lamp.id, figure


def by_kind(found: Sequence[Figure]) -> dict[str, dict[str, float]]:
    """Count, root mean square error and usual sigma, mm, and normalised errors' root mean square of each class."""
    table: dict[str, dict[str, float]] = {}
    for kind in KINDS:
        pairs = np.array([(error, sigma) for other, error, sigma in found if other == kind])
        if len(pairs):
            rms = float(np.sqrt(np.mean(pairs[:, 0] ** 2)))
            spread = float(np.sqrt(np.mean((pairs[:, 0] / pairs[:, 1]) ** 2)))
            sigma = float(np.median(pairs[:, 1]))
            table[kind] = {"count": len(pairs), "error_mm": 1e3 * rms, "sigma_mm": 1e3 * sigma, "spread": spread}
    return table


def line(name: str, table: Mapping[str, Mapping[str, float]], factor: str) -> str:
    """A row of the printed table: error / sigma, both mm, = spread."""
    empty = f"{'-':>20}"
    cells = (
        f"{cell['error_mm']:6.1f}/{cell['sigma_mm']:5.1f} = {cell['spread']:4.2f}".rjust(20) if cell else empty
        for cell in (table.get(kind) for kind in KINDS)
    )
    return f"{name[:22]:22}" + "".join(cells) + f"  {factor}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("sites", nargs="+", type=Path)
    parser.add_argument("--keep", type=Path, help="keep what was measured in this folder")
    parser.add_argument("-o", "--output", type=Path, default=ROOT / "bench" / "results" / "sigmas.json")
    arguments = parser.parse_args()
    results: dict[str, Any] = {}
    everything: list[Figure] = []
    print(
        f"{'rms / sigma mm = ratio':22}" + "".join(f"{kind:>20}" for kind in KINDS) + "  variance factors", flush=True
    )
    for site in arguments.sites:
        name = site.absolute().parent.name
        try:
            row, survey = mapped(site, arguments.keep)
        except SavmapError as error:
            print(f"{name[:22]:22}{error}"[:140], flush=True)
            continue
        found = list(figures(row, survey))
        everything += found
        factors = {key: value for key, value in row.report.items() if key.startswith("variance_inflation")}
        results[name] = {"classes": by_kind(found), "factors": factors}
        print(line(name, results[name]["classes"], " ".join(f"{value:.3g}" for value in factors.values())), flush=True)
    results["all"] = {"classes": by_kind(everything)}
    print(line("all", results["all"]["classes"], ""))
    write_text(arguments.output, json.dumps(results, indent=2) + "\n")


if __name__ == "__main__":
    main()
