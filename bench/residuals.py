"""Pictures of residuals: what masks' edges and measured edges leave in the view, and in the map.

    python bench/residuals.py [SITE] [-o docs/pictures/residuals.png]

Left: residuals of uprights' edges by the column of the view, outwards of the structure, px: mean and standard deviation. Middle: mean
residual of beams' edges over the view. Right: truth - estimate of widths and gaps by class.
"""

import argparse
import tempfile
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from footage import ROOT as REPOSITORY
from footage import TrackedShelves, ours, problem_of, track_shelves

from savmap.cli.console import Console
from savmap.graph import solve
from savmap.types import Floats
from savmap_shelves.mapping import describe
from savmap_shelves.report.evaluation import evaluate

mpl.use("Agg")
from matplotlib import pyplot as plt

WAYS = (("masks' edges", False), ("measured edges", True))
CLASSES = ("V element", "V gap", "H element", "H gap")
OUTWARDS = {"left": (0, -1.0), "right": (0, 1.0), "upper": (1, -1.0), "lower": (1, 1.0)}
CELLS = (16, 12)
LIMIT_PX, GROSS_PX = 0.6, 5.0


def residuals(shelves: TrackedShelves) -> tuple[dict[str, Floats], dict[str, Floats]]:
    """Pixels and residual outwards (n, 3) of each class, and errors of the map by class, m."""
    problem = problem_of(shelves, ours(shelves))
    solution = solve(problem)
    poses = solution.trajectory.world_from_rig[np.searchsorted(solution.trajectory.frames, problem.used)]
    points = np.array([solution.landmarks_of("shelves")[problem.name_of(int(key))[1]].position for key in problem.keys])
    roots = np.linalg.cholesky(problem.measurements.covariances)
    pixels = np.einsum("nij,nj->ni", roots, problem.residuals(poses, points))
    normals = np.linalg.eigh(problem.measurements.covariances)[1][:, :, 0]
    across = np.einsum("ni,ni->n", normals, pixels)
    by_label: dict[str, list[Floats]] = {"upright": [], "beam": []}
    names = [problem.name_of(int(key))[1] for key in problem.measurements.keys]
    for at, off, normal, name in zip(problem.measurements.pixels, across, normals, names, strict=True):
        label = "upright" if name.startswith("upright") else "beam"
        part = next((part for part in name.replace(" /", "").split() if part in OUTWARDS), None)
        if part is not None and abs(off) < GROSS_PX:
            axis, sign = OUTWARDS[part]
            by_label[label].append(np.array([*at, -sign * np.sign(normal[axis]) * off]))
    errors = dict(evaluate(describe(shelves.tracks, solution), shelves.survey).errors)
    return {label: np.array(rows) for label, rows in by_label.items()}, errors


def over_the_view(axes: Any, rows: Floats, title: str) -> Any:
    """Mean residual in each cell of the view."""
    edges = [np.linspace(0, size, count + 1) for size, count in zip((640, 480), CELLS, strict=True)]
    total = np.histogram2d(rows[:, 0], rows[:, 1], edges, weights=rows[:, 2])[0]
    count = np.histogram2d(rows[:, 0], rows[:, 1], edges)[0]
    mean = np.where(count >= 3, total / np.maximum(count, 1), np.nan)
    shown = axes.pcolormesh(edges[0], edges[1], mean.T, cmap="RdBu_r", vmin=-LIMIT_PX, vmax=LIMIT_PX)
    axes.set(aspect="equal", xlim=(0, 640), ylim=(480, 0), xticks=[], yticks=[])
    axes.set_title(f"{title}: rms {np.sqrt(np.mean(rows[:, 2] ** 2)):.2f} px", fontsize=9)
    return shown


def by_column(axes: Any, rows: Floats, title: str) -> None:
    """Mean residual and standard deviation in each strip of columns."""
    edges = np.linspace(0, 640, CELLS[0] + 1)
    strip = np.digitize(rows[:, 0], edges) - 1
    strips = [rows[strip == number, 2] for number in range(CELLS[0])]
    known = [number for number, values in enumerate(strips) if len(values) >= 3]
    mean, spread = ([float(figure(strips[number])) for number in known] for figure in (np.mean, np.std))
    axes.errorbar((edges[:-1] + edges[1:])[known] / 2, mean, spread, fmt="o", markersize=3, capsize=2)
    axes.axhline(0, color="#868e96", linewidth=0.8)
    axes.set(xlim=(0, 640), ylim=(-2.5, 2.5), xlabel="column, px", ylabel="residual outwards, px")
    axes.set_title(f"{title}: rms {np.sqrt(np.mean(rows[:, 2] ** 2)):.2f} px", fontsize=9)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("site", nargs="?", type=Path, default=REPOSITORY / "examples" / "aisle-dev" / "site.yaml")
    parser.add_argument("-o", "--output", type=Path, default=REPOSITORY / "docs" / "pictures" / "residuals.png")
    arguments = parser.parse_args()
    figure, axes = plt.subplots(2, 3, figsize=(11, 5.6), layout="constrained")
    with tempfile.TemporaryDirectory() as scratch, Console(Path(scratch) / "log") as console:
        for row, (name, subpixel) in enumerate(WAYS):
            pixels, errors = residuals(track_shelves(arguments.site, subpixel, console))
            by_column(axes[row, 0], pixels["upright"], f"uprights, {name}")
            shown = over_the_view(axes[row, 1], pixels["beam"], f"beams, {name}")
            axes[row, 2].boxplot([100 * errors[kind] for kind in CLASSES], tick_labels=CLASSES, showmeans=True)
            axes[row, 2].axhline(0, color="#868e96", linewidth=0.8)
            axes[row, 2].set(ylim=(-2, 2), ylabel="truth - estimate, cm")
            axes[row, 2].set_title(f"map, {name}", fontsize=9)
    figure.colorbar(shown, ax=axes[:, 1], label="mean residual outwards, px", shrink=0.8)
    arguments.output.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(arguments.output, dpi=90)
    print(arguments.output)


if __name__ == "__main__":
    main()
