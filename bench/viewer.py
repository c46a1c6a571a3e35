"""The viewer of a large site in a real browser: how large its page is, how long it takes to open, and what a frame costs.

    python -m bench viewer MAP [--rows 46] [--elements 6700] [--dates] [--size 1360x800] [--keep DIR]

A row of a map, such as the demo's, is repeated along its length and over so many rows, back to back in pairs across aisles, until it has so many
elements. With --dates it is compared with itself, and both dates are in the page. It is opened from the disk in the Chromium on the path, drawn
by the processor only (SwiftShader): a machine with any graphics does more frames. What counts is the script's time for a frame, and the draw
calls, triangles and lines that the graphics are given, of which ordinary ones draw some hundreds and some millions 30 times a second.
"""

import argparse
import shutil
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from playwright.sync_api import Page, sync_playwright

from bench.baseline import Figures
from savmap.apps.dates.comparison.compare import compare_maps
from savmap.apps.viewer.data import Before
from savmap.apps.viewer.page import View, write_view
from savmap.maps.map_file import read_map
from savmap.types import Floats, JointCovariance, Placement, RowMap, SiteMap, Structure

ARGUMENTS = ("--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")
AISLE_M, RACK_M = 3.5, 2.4


def large_site(row: RowMap, rows: int, elements: int) -> SiteMap:
    """A site of so many rows and, at least, elements."""
    count = sum(map(len, row.structures.values()))
    times = max(1, -(-elements // (rows * count)))
    names = [f"{chr(65 + k // 10)}{k % 10 + 1}" for k in range(rows)]
    longer = lengthened(row, times)
    places = dict(zip(names, _places(rows, _length(longer)), strict=True))
    return SiteMap({name: replace(longer, name=name) for name in names}, {}, {}, places)


def lengthened(row: RowMap, times: int) -> RowMap:
    """A row, so many times one after the other; each part's errors go together as the first one's do."""
    step = _length(row)
    structures = {
        plugin: tuple(_moved(one, k, step) for k in range(times) for one in group)
        for plugin, group in row.structures.items()
    }
    joint = row.joint and _repeated(row.joint, times)
    return replace(row, structures=structures, joint=joint)


def _repeated(joint: JointCovariance, times: int) -> JointCovariance:
    size = len(joint.covariance)
    numbers = {
        plugin: {
            _name(name, k): np.where(found < 0, -1, found + k * size)
            for k in range(times)
            for name, found in group.items()
        }
        for plugin, group in joint.coordinates.items()
    }
    return JointCovariance(numbers, np.asarray(np.kron(np.eye(times), joint.covariance), np.float64))


def _moved(structure: Structure, number: int, step: float) -> Structure:
    name = _name(structure.id, number)
    labels = tuple(label.replace(structure.id, name) for label in structure.vertex_labels)
    along = np.array([number * step, 0.0, 0.0])
    vertices = structure.vertices + along
    solid = structure.solid and replace(structure.solid, outline=structure.solid.outline + along)
    return replace(structure, id=name, vertices=vertices, vertex_labels=labels, solid=solid)


def _name(name: str, number: int) -> str:
    return name if number == 0 else f"part {number + 1} {name}"


def _length(row: RowMap) -> float:
    face = [
        one.vertices[:, 0] for group in row.structures.values() for one in group if abs(one.vertices[:, 2]).max() < 0.5
    ]
    along = np.concatenate(face)
    return float(along.max() - along.min())


def _places(rows: int, length: float) -> Iterator[Placement]:
    """Aisles with a row on either hand, their faces towards each other."""
    covariance: Floats = np.diag([4e-4, 4e-4, 1e-3])
    for k in range(rows):
        z = (k // 2) * (AISLE_M + RACK_M)
        yield Placement(0.0, z, 0.0, covariance) if k % 2 == 0 else Placement(length, z + AISLE_M, 180.0, covariance)


def opened(page: Page, file: Path) -> dict[str, float]:
    """Open a page and turn it around: seconds until it can be used, frames a second and what a frame at rest asks for. Lines of its console are
    printed and counted."""
    lines: list[str] = []
    page.on("console", lambda message: lines.append(message.text))
    page.on("pageerror", lambda error: lines.append(str(error)))
    begin = time.perf_counter()
    page.goto(file.resolve().as_uri())
    page.wait_for_selector("html[data-ready=yes]")
    open_s = time.perf_counter() - begin
    turn = "savmapViewer.stage.spin(40).then((found) => [...found, savmapViewer.stage.renderer.getPixelRatio()])"
    frames_s, script_ms, ratio = page.evaluate(turn)
    names = ("draw calls", "triangles", "lines", "points", "script ms at rest")
    load = dict(zip(names, page.evaluate("savmapViewer.stage.load()"), strict=True))
    print(*lines, sep="\n", end="\n" if lines else "")
    turning = {"opened s": open_s, "frames a second": frames_s, "script ms": script_ms, "pixels by pixel": ratio}
    return {**turning, **load, "console lines": len(lines)}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of this bench."""
    parser.add_argument("map", type=Path)
    parser.add_argument("--rows", type=int, default=46)
    parser.add_argument("--elements", type=int, default=6700)
    parser.add_argument("--dates", action="store_true")
    parser.add_argument("--size", default="1360x800")


def run(given: argparse.Namespace) -> Figures:
    """Make the page, open it, measure."""
    site = large_site(next(iter(read_map(given.map).rows.values())), given.rows, given.elements)
    before = Before(site, compare_maps(site, site)) if given.dates else None
    width, height = map(int, given.size.split("x"))
    browser_path = shutil.which("chromium") or shutil.which("google-chrome")
    with sync_playwright() as started:
        folder = given.keep
        file = folder / "view.html"
        begin = time.perf_counter()
        write_view(View(site, title=f"{given.rows} rows", before=before), file)
        written_s, size_mb = time.perf_counter() - begin, file.stat().st_size / 1e6
        browser = started.chromium.launch(executable_path=browser_path, args=list(ARGUMENTS))
        page = browser.new_page(viewport={"width": width, "height": height})
        figures = opened(page, file)
        page.evaluate("savmapViewer.setKind('model')")
        page.wait_for_timeout(300)
        page.screenshot(path=folder / "view.png")
        browser.close()
    elements = sum(len(group) for row in site.rows.values() for group in row.structures.values())
    return {f"{len(site.rows)} rows": {"elements": elements, "MB": size_mb, "written s": written_s, **figures}}
