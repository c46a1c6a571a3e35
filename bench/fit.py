"""The parameters of the face's model by maximum likelihood on train rows, written with their provenance.

    python -m bench fit [--count 6] [--family rows "grey rows" "dark rows"] [--keep DIR] [--write]

Measures both faces of the first drives of each family, as far as a drive goes past all of them, lays the survey on the
evidence that the model read last, and fits. DIR keeps footage, what was seen of it, and the evidence: another run only
fits. Figures: the log likelihood of the surveyed members, nats, with the first guess and the fitted values. `--write`
takes these into the shipped file: only if `python -m bench rows` is better by its totals.
"""

import argparse
import json
from collections import Counter
from collections.abc import Iterator
from dataclasses import asdict
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from bench.baseline import Figures
from bench.rows import FAMILIES, measured, sites, survey_on_face
from savmap.errors import SavmapError, StructureError
from savmap.files.atomic import write_bytes, write_text
from savmap.files.serialization import packed, unpacked
from savmap_shelves.face_model import FaceReader
from savmap_shelves.lab.fit import LaidSurvey, SurveyedFace, fit
from savmap_shelves.likelihood import FITTED, stored

EVIDENCE, GUESS = "evidence", "first guess"
LEAST_SHARE = 0.5
"""Of what was found that the survey has: below it the path is so wrong that the survey is not where the evidence is."""


def surveyed(site: Path, output: Path) -> SurveyedFace:
    """The evidence of a simulated site's only row, with its survey, kept in a folder. Raises SavmapError."""
    kept = output / EVIDENCE
    if not kept.is_file():
        face = measured(site, output, ["shelves"])
        survey, reader = survey_on_face(site, face), face.reader
        mapped = [item for item in face.row.measurements.objects["shelves"] if item.is_mapped]
        written = {
            "reader": [reader.uprights, reader.beams, reader.distance, reader.floor, reader.sizes],
            "posts": survey.posts,
            "sections": survey.sections,
            "share": np.mean([exists for _, exists in survey.existing(mapped)]),
        }
        write_bytes(kept, packed(written))
    content: dict[str, Any] = unpacked(kept.read_bytes(), dict)
    if content["share"] < LEAST_SHARE:
        raise StructureError(f"only {100 * content['share']:.0f} % of what was found is where the survey has something")
    uprights, beams, distance, floor, sizes = content["reader"]
    reader = FaceReader(uprights, beams, distance, floor, stored(GUESS), sizes)
    return SurveyedFace(reader, LaidSurvey(content["posts"], content["sections"]))


def faces(given: argparse.Namespace, base: Path) -> Iterator[tuple[str, int, SurveyedFace]]:
    """Family, seed and evidence of each face that can be measured."""
    for family, seed, site, output in sites(given, base):
        try:
            yield family, seed, surveyed(site, output)
        except SavmapError as error:
            print(f"{family}, seed {seed}: {error}"[:120], flush=True)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of this bench."""
    parser.add_argument("--count", type=int, default=6, help="of drives of each family")
    parser.add_argument("--family", choices=FAMILIES, nargs="+", default=FAMILIES[:3])
    parser.add_argument("--frames", type=int, default=40)
    parser.add_argument("--write", action="store_true", help="take the fitted values into the shipped file")
    parser.set_defaults(set="train", row="both", references="camera")


def run(given: argparse.Namespace) -> Figures:
    """Fit, and print or write the parameters."""
    read = [*faces(given, given.keep)]
    result = fit([face for *_, face in read], stored(GUESS))
    provenance = {
        "fitted": "maximum posterior of the surveyed members of simulated rows",
        "faces": Counter(family for family, *_ in read),
        "seeds": {family: sorted({seed for other, seed, _ in read if other == family}) for family in given.family},
        "members": result.members,
        "log likelihood, nats": {"first guess": round(result.before, 1), "fitted": round(result.after, 1)},
        "date": datetime.now(UTC).date().isoformat(),
        "command": "python -m bench fit",
    }
    content = {"provenance": provenance, "parameters": asdict(result.parameters)}
    text = json.dumps({**content, GUESS: asdict(stored(GUESS))}, indent=1) + "\n"
    print(text)
    if given.write:
        write_text(FITTED, text)
    counts = {"faces": len(read), "lines": result.lines, "members": result.members}
    return {"fit": {**counts, "first guess nats": result.before, "fitted nats": result.after}}
