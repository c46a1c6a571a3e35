"""A camera that is off: what a mis-stitched panorama and a rolling shutter cost, and what estimating them gives back.

    python bench/calibration.py [--rows 4] [--sections 3] [--case NAME] [-o bench/results/calibration.json]

Rows at observation level, masks' edges with 0.5 px of noise, references off by their sigmas, as in `observed_rows`; the view
looks to the side, so that the seam of the two lenses is in its middle. An edge that crosses the seam is seen as the straight
line that fits best. Printed: mean absolute errors of maps without a term and with each; how far off the parameters are,
and the root mean square of that in their sigmas (1 is right).
"""

import argparse
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from observed_rows import Mapped, driven_row, given, mapped, tracked

from savmap.files.atomic import write_text
from savmap.graph import Calibration, Shutter, Stitching
from savmap.lab.sim.drive.optics import Optics
from savmap.lab.sim.observations import MaskErrors
from savmap.report.evaluation import mean_absolute_error
from savmap.types import Floats, pool

ROOT = Path(__file__).parent.parent
ERRORS = MaskErrors(0.5)
TERMS: Mapping[str, Calibration | None] = {
    "off": None,
    "panorama": Calibration(Stitching()),
    "shutter": Calibration(None, Shutter()),
    "both": Calibration(Stitching(), Shutter()),
}


@dataclass(frozen=True)
class Case:
    """Size of the turn of one half against the other, degrees; of the lenses' scales, one and the other way; read-out, s."""

    turn_deg: float = 0.0
    scale: float = 0.0
    read_out_s: float = 0.0

    def optics(self, seed: int) -> Optics | None:
        """With the turn about a random axis; none where nothing is off."""
        if not (self.turn_deg or self.scale or self.read_out_s):
            return None
        axis = np.random.default_rng([seed, 5]).normal(size=3)
        x, y, z = (self.turn_deg * axis / np.linalg.norm(axis)).tolist()
        return Optics((x, y, z), (self.scale, -self.scale), self.read_out_s)


CASES: Mapping[str, Case] = {
    "nothing off": Case(),
    "1 degree": Case(1.0),
    "1.5 degrees, 0.3 %": Case(1.5, 0.003),
    "20 ms": Case(read_out_s=0.02),
    "1 degree and 20 ms": Case(1.0, read_out_s=0.02),
}


def parameters(row: Mapped, optics: Optics, term: Calibration) -> tuple[Floats, Floats]:
    """Errors (p,) of the parameters as reported: degrees, percent, milliseconds; and in their sigmas."""
    truth = [*optics.turn_deg, *(100 * scale for scale in optics.scales)] if term.stitching else []
    truth += [1e3 * optics.read_out_s] if term.shutter else []
    report = {name: value for name, value in row.solution.report.items() if name.startswith("calibration ")}
    values = [float(value) for name, value in report.items() if ", sigma" not in name]
    sigmas = [float(value) for name, value in report.items() if ", sigma" in name]
    off = np.array(values) - np.array(truth)
    return off, off / np.array(sigmas)


def run_case(case: Case, rows: int, sections: int, frames: int = 20) -> dict[str, dict[str, float]]:
    """Figures by term; `frames` a bay."""
    scores: dict[str, list[Mapped]] = {name: [] for name in TERMS}
    off: dict[str, list[tuple[Floats, Floats]]] = {name: [] for name in TERMS}
    for seed in range(rows):
        optics = case.optics(seed)
        driven = driven_row(3000 + seed, ERRORS, sections=sections, frames_a_section=frames, optics=optics)
        known, tracks = given(driven, np.random.default_rng([seed, 9]), profiles=False), tracked(driven)
        for name, term in TERMS.items():
            row = mapped(driven, known, tracks=tracks, calibration=term)
            scores[name].append(row)
            if term is not None:
                off[name].append(parameters(row, optics or Optics(), term))
    return {name: figures(scores[name], off[name]) for name in TERMS}


def figures(rows: list[Mapped], off: list[tuple[Floats, Floats]]) -> dict[str, float]:
    """Mean absolute error, residuals' scale, and how far off the parameters are."""
    mean = mean_absolute_error(pool(row.score for row in rows))
    result = {
        "mae_m": float("nan") if mean is None else mean,
        "residual_scale": float(np.mean([float(row.solution.report["residual_scale"]) for row in rows])),
    }
    if off:
        errors, normalised = (np.array(part) for part in zip(*off, strict=True))
        if errors.shape[1] > 1:
            result["turn_rms_deg"] = float(np.sqrt(np.mean(errors[:, :3] ** 2)))
            result["scale_rms_percent"] = float(np.sqrt(np.mean(errors[:, 3:5] ** 2)))
        if errors.shape[1] != 5:
            result["read_out_rms_ms"] = float(np.sqrt(np.mean(errors[:, -1] ** 2)))
        result["spread"] = float(np.sqrt(np.mean(normalised**2)))
    return result


def line(name: str, case: Mapping[str, Mapping[str, float]]) -> str:
    """One row of the table."""
    errors = "".join(f"{100 * term['mae_m']:10.3f}" for term in case.values())
    both = case["both"]
    keys = ("turn_rms_deg", "scale_rms_percent", "read_out_rms_ms", "spread")
    return f"{name:22}{errors}" + "".join(f"{both[key]:11.3f}" for key in keys)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rows", type=int, default=4)
    parser.add_argument("--sections", type=int, default=3)
    parser.add_argument("--case", choices=tuple(CASES), action="append")
    parser.add_argument("-o", "--output", type=Path, default=ROOT / "bench" / "results" / "calibration.json")
    arguments = parser.parse_args()
    heads = [*(f"{name}, cm" for name in TERMS), "turn, deg", "scale, %", "read, ms", "in sigmas"]
    print(f"{'':22}" + "".join(f"{head:>{10 if 'cm' in head else 11}}" for head in heads), flush=True)
    results: dict[str, dict[str, dict[str, float]]] = {}
    for name in arguments.case or CASES:
        results[name] = run_case(CASES[name], arguments.rows, arguments.sections)
        print(line(name, results[name]), flush=True)
    write_text(arguments.output, json.dumps(results, indent=2) + "\n")


if __name__ == "__main__":
    main()
