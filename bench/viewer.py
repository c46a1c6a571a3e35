"""The viewer of a large site in a real browser: how large its page is, how long it takes to open, frames a second while it turns, and what a frame
asks of the graphics.

    python bench/viewer.py MAP [--rows 46] [--elements 6700] [--dates] [--size 1360x800] [-o bench/results/viewer]

A row of a map, such as the demo's, is repeated along its length and over so many rows, back to back in pairs across aisles, until it has so many
elements. With --dates it is compared with itself, and both dates are in the page. It is opened from the disk in the Chromium on the path, drawn by the processor alone (SwiftShader): a machine with any graphics
does more frames. How many those are nobody tried here: what tells is the script's time for a frame, and the draw calls, triangles and lines that the
graphics are given, of which ordinary ones draw some hundreds and some millions 30 times a second. Ends with 1 where the page is over 3 MB, opens in more than 2 s, or says anything on the console.
"""

import argparse
import shutil
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from playwright.sync_api import Page, sync_playwright

from savmap.maps.comparison import compare_maps
from savmap.maps.map_file import read_map
from savmap.report.viewer import Before, View, write_view
from savmap.types import Floats, JointCovariance, Placement, RowMap, SiteMap, Structure

ARGUMENTS = ("--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")
AISLE_M, RACK_M = 3.5, 2.4
MOST_MB, MOST_S = 3.0, 2.0


@dataclass(frozen=True)
class Opened:
    """Seconds until the page could be used, frames a second, milliseconds of each that its script takes or waits, the canvas's pixels by pixels of the
    page in the last of them (less than 1: drawn coarser while it moves), what it said on the console, and of a frame at rest the draw calls,
    triangles, lines, points,
    and the milliseconds of script while the graphics wait for it."""

    open_s: float
    frames_s: float
    script_ms: float
    ratio: float
    said: tuple[str, ...]
    load: tuple[float, ...]


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


def opened(page: Page, file: Path) -> Opened:
    """Open a page and turn it around."""
    said: list[str] = []
    page.on("console", lambda message: said.append(message.text))
    page.on("pageerror", lambda error: said.append(str(error)))
    begin = time.perf_counter()
    page.goto(file.resolve().as_uri())
    page.wait_for_selector("html[data-ready=yes]")
    open_s = time.perf_counter() - begin
    turned = "savmapViewer.stage.spin(40).then((found) => [...found, savmapViewer.stage.renderer.getPixelRatio()])"
    frames_s, script_ms, ratio = page.evaluate(turned)
    load = page.evaluate("savmapViewer.stage.load()")
    return Opened(open_s, frames_s, script_ms, ratio, tuple(said), tuple(load))


def main() -> int:
    """Make it, open it, print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("map", type=Path)
    parser.add_argument("--rows", type=int, default=46)
    parser.add_argument("--elements", type=int, default=6700)
    parser.add_argument("--dates", action="store_true")
    parser.add_argument("--size", default="1360x800")
    parser.add_argument("-o", "--output", type=Path, default=Path("bench/results/viewer"))
    arguments = parser.parse_args()
    site = large_site(next(iter(read_map(arguments.map).rows.values())), arguments.rows, arguments.elements)
    file = arguments.output / "view.html"
    before = Before(site, compare_maps(site, site)) if arguments.dates else None
    begin = time.perf_counter()
    write_view(View(site, title=f"{arguments.rows} rows", before=before), file)
    written_s, size_mb = time.perf_counter() - begin, file.stat().st_size / 1e6
    count = sum(len(group) for row in site.rows.values() for group in row.structures.values())
    width, height = map(int, arguments.size.split("x"))
    browser_path = shutil.which("chromium") or shutil.which("google-chrome")
    with sync_playwright() as started:
        browser = started.chromium.launch(executable_path=browser_path, args=list(ARGUMENTS))
        page = browser.new_page(viewport={"width": width, "height": height})
        result = opened(page, file)
        page.evaluate("savmapViewer.setKind('model')")
        page.wait_for_timeout(300)
        page.screenshot(path=arguments.output / "view.png")
        browser.close()
    print(f"{len(site.rows)} rows, {count} elements: {size_mb:.2f} MB, written in {written_s:.1f} s")
    print(
        f"opened in {result.open_s:.2f} s, {result.frames_s:.0f} frames a second at {arguments.size} x {result.ratio:g} without graphics, script with its waiting for them {result.script_ms:.0f} ms"
    )
    calls, triangles, lines, points, own_ms = result.load
    print(
        f"a frame at rest: {calls} draw calls, {triangles} triangles, {lines} lines, {points} points, script {own_ms:.1f} ms"
    )
    print(*result.said, sep="\n")
    return int(size_mb > MOST_MB or result.open_s > MOST_S or bool(result.said))


if __name__ == "__main__":
    sys.exit(main())
