"""A map in formats that other programs read: ASCII PLY (vertices, edges, a colour for each label) and CSV (vertices)."""

import csv
import io
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from savmap.errors import OutputError
from savmap.io.files import write_text
from savmap.types import RowMap, SiteMap, Structure

COLOURS = ((31, 119, 180), (255, 127, 14), (44, 160, 44), (214, 39, 40), (148, 103, 189), (140, 86, 75))
COLUMNS = ["row", "plugin", "structure", "label", "vertex", "x_m", "y_m", "z_m", "sigma_x_m", "sigma_y_m", "sigma_z_m"]


def write_csv(site: SiteMap, path: Path) -> None:
    """A line a vertex: where it belongs, its place in the row's frame and its standard deviations, m. Raises OutputError."""
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow(COLUMNS)
    for row in site.rows.values():
        for plugin, structures in row.structures.items():
            for own in structures:
                table.writerows((row.name, plugin, own.id, own.label, *vertex) for vertex in _vertices(own))
    write_text(path, text.getvalue())


def write_ply(site: SiteMap, path: Path) -> None:
    """One row's wireframe, metres. Raises OutputError, also for a map of several rows: each has a frame of its own."""
    if len(site.rows) != 1:
        raise OutputError(
            f"{path}: PLY holds one row's frame, the map has rows {', '.join(site.rows)}; choose with --row"
        )
    write_text(path, "\n".join(_ply(next(iter(site.rows.values())))) + "\n")


def _vertices(own: Structure) -> Iterator[tuple[str, ...]]:
    sigmas = np.sqrt(np.maximum(np.diagonal(own.covariances, axis1=1, axis2=2), 0.0))
    for label, place, sigma in zip(own.vertex_labels, own.vertices, sigmas, strict=True):
        yield (label, *(f"{value:.4f}" for value in place), *(f"{value:.5f}" for value in sigma))


def _ply(row: RowMap) -> Iterator[str]:
    structures = [own for group in row.structures.values() for own in group]
    labels = sorted({own.label for own in structures})
    colours = {label: COLOURS[k % len(COLOURS)] for k, label in enumerate(labels)}
    firsts = np.cumsum([0, *(len(own.vertices) for own in structures)]).tolist()
    yield from ("ply", "format ascii 1.0", f"comment savmap row {row.name}, metres")
    for label, colour in colours.items():
        yield f"comment label {label}: {_spaced(colour)}"
    yield f"element vertex {firsts[-1]}"
    yield from (f"property double {axis}" for axis in "xyz")
    yield from (f"property uchar {channel}" for channel in ("red", "green", "blue"))
    yield f"element edge {sum(len(own.edges) for own in structures)}"
    yield from ("property int vertex1", "property int vertex2", "end_header")
    for own in structures:
        yield from (f"{x:.4f} {y:.4f} {z:.4f} {_spaced(colours[own.label])}" for x, y, z in own.vertices.tolist())
    for first, own in zip(firsts, structures, strict=False):
        yield from (f"{first + a} {first + b}" for a, b in own.edges.tolist())


def _spaced(colour: tuple[int, int, int]) -> str:
    return " ".join(map(str, colour))
