"""Rows whose face is a real photograph, from simulated footage to scored map: missing, spurious, error, warnings.

    python bench/photo_rows.py [--model FILE] [--faces NAME,...] [--only colour,grey,dim] [--photos DIR] [--keep DIR] [-o bench/results/photo_rows.json]

A face is the front of a rectified photograph (real paint, real goods), laid on the plane of a row and repeated along it
(`photo_faces`, `photo_rows/faces.json`); the drive, the hall and its lamps are simulated. Each face stands in colour, in grey and
at a third of the light. Goods lie in the plane: parallax is missing. Photographs are fetched by address and digest into
`--photos`, they are not redistributed. Footage already in DIR is used again.
"""

import argparse
import json
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from photo_faces import Face, photo_row, read_faces
from photo_files import PHOTOS, photo
from photo_footage import LIGHTS, Size, make_footage

import savmap
from savmap.errors import SavmapError
from savmap.files.atomic import write_text
from savmap.report.evaluation import as_json
from savmap.types import SiteMap

ROOT = Path(__file__).parent.parent
KINDS = ("upright", "beam")
_GOOD_M = 0.015


@dataclass(frozen=True)
class Case:
    """A face in one light."""

    face: Face
    light: str

    @property
    def name(self) -> str:
        """Such as "gmu-grey"."""
        return f"{self.face.name}-{self.light}"


def footage(case: Case, base: Path, photos: Path, size: Size) -> Path:
    """The site file of a case's footage; that of all lights of its face is made unless it is there."""
    site = base / case.name / "site.yaml"
    if not site.is_file():
        row = photo_row(case.face, photo(case.face.entry, photos))
        folders = {light: base / Case(case.face, light).name for light in LIGHTS}
        make_footage(row, case.face.name, folders, size)
    return site


def score(site: Path, output: Path, model: Path | None = None) -> dict[str, Any]:
    """Map a site and score it, with what the map warns of; an error is named, and is a warning too."""
    start = time.perf_counter()
    try:
        overrides = [f"plugins.shelves.model={model.resolve()}"] if model else []
        site_map = savmap.map_site(site, output=output, overrides=overrides)
        figures = as_json(savmap.evaluate(site_map, site.with_name("survey.json")))
        figures = {key: figures[key] for key in ("mae_m", "missing", "spurious", "classes", "edges")}
        figures["warnings"] = warnings_of(site_map)
    except SavmapError as error:
        figures = {"error": str(error), "warnings": [str(error)]}
    return {**figures, "seconds": time.perf_counter() - start}


def warnings_of(site_map: SiteMap) -> list[str]:
    """What a map itself warns of, and why rows failed."""
    notes = [str(note) for row in site_map.rows.values() for key, note in row.report.items() if key.startswith("note ")]
    return [*notes, *site_map.failed.values()]


def is_good(figures: Mapping[str, Any]) -> bool:
    """Whether a map misses nothing, invents nothing, and is off by at most 1.5 cm."""
    if "error" in figures or any(figures["missing"].values()) or any(figures["spurious"].values()):
        return False
    return bool(figures["mae_m"] <= _GOOD_M)


def line(name: str, figures: Mapping[str, Any]) -> str:
    """One row of the table."""
    if "error" in figures:
        return f"{name:24} {figures['error'][:100]}"
    counts = "".join(f"{figures[what].get(kind, 0):10d}" for what in ("missing", "spurious") for kind in KINDS)
    error = f"{100 * figures['mae_m']:8.2f}" if figures["mae_m"] is not None else f"{'-':>8}"
    return f"{name:24}{counts} {error} {len(figures['warnings']):8d} {figures['seconds']:8.0f}"


def summary(results: Mapping[str, Mapping[str, Any]]) -> str:
    """How many cases are good, and which are wrong without a word."""
    good = sum(is_good(figures) for figures in results.values())
    silent = [name for name, figures in results.items() if not is_good(figures) and not figures["warnings"]]
    return f"{good} of {len(results)} good (0 missing, 0 spurious, at most 1.5 cm); wrong without a warning: {', '.join(silent) or 'none'}"


def cases(names: Sequence[str], lights: Sequence[str]) -> Iterator[Case]:
    """The cases asked for."""
    faces = read_faces()
    unknown = [name for name in names if name not in faces] + [light for light in lights if light not in LIGHTS]
    if unknown:
        raise SystemExit(f"{', '.join(unknown)}: choose of {', '.join(faces)}; {', '.join(LIGHTS)}")
    for name in names or faces:
        yield from (Case(faces[name], light) for light in lights or LIGHTS)


def _names(text: str) -> list[str]:
    return [name for name in text.split(",") if name]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--faces", type=_names, default=[], help="names in faces.json, with commas; all of them")
    parser.add_argument("--only", type=_names, default=[], help="of colour, grey, dim, with commas; all of them")
    parser.add_argument("--photos", type=Path, default=PHOTOS, help="the photographs' folder")
    parser.add_argument("--keep", type=Path, help="keep footage and maps in this folder")
    parser.add_argument("--render-only", action="store_true", help="make the footage, map nothing")
    parser.add_argument("--model", type=Path, help="another network than the plugin's")
    parser.add_argument("--frames", type=int, default=50)
    parser.add_argument("--width", type=int, default=2048)
    parser.add_argument("-o", "--output", type=Path, default=ROOT / "bench" / "results" / "photo_rows.json")
    arguments = parser.parse_args()
    results: dict[str, dict[str, Any]] = {}
    heads = "".join(f"{f'{what} {kind}':>10}" for what in ("miss", "spur") for kind in ("post", "beam"))
    print(f"{'case':24}{heads} {'MAE cm':>8} {'warnings':>8} {'seconds':>8}", flush=True)
    with tempfile.TemporaryDirectory() as temporary:
        for case in cases(arguments.faces, arguments.only):
            base = arguments.keep or Path(temporary)
            site = footage(case, base, arguments.photos, Size(arguments.frames, arguments.width))
            if not arguments.render_only:
                results[case.name] = score(site, base / case.name / "out", arguments.model)
                print(line(case.name, results[case.name]), flush=True)
    if results:
        print(summary(results))
        write_text(arguments.output, json.dumps(results, indent=2) + "\n")


if __name__ == "__main__":
    main()
