"""The documentation is run: every command of its pages in the order of the page, on the footage that ships, then the page's Python. What a page
says that a command prints, or leaves as a file, is held against what it did.

A command is a line of an indented block that begins with a program; what else stands in the block, and in a block ```text after it, is what it
prints, where `...` stands for any lines. Figures agree to a tenth, or to five units of their last decimal: they differ between processors.
"""

import importlib
import json
import os
import re
import shlex
import shutil
import subprocess
import sys
import textwrap
import time
import tomllib
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from itertools import islice
from pathlib import Path

import av
import nbformat
import numpy as np
import pytest
import yaml
from nbclient import NotebookClient
from PIL import Image
from typer.core import TyperGroup
from typer.main import get_command

import savmap
from savmap.cli.app import app
from savmap.demo import SITE
from savmap.video.clip import Clip
from savmap.video.reader import panoramas
from tests.conftest import installed

ROOT = Path(__file__).parents[1]
PAGES = ("README.md", *sorted(path.relative_to(ROOT).as_posix() for path in (ROOT / "docs").rglob("*.md")))
PROGRAM = re.compile(
    r"\(?(?:[A-Z_]+=\S+ )*(?:\.venv/bin/)?(?:savmap|python3?|pip|cp|cd|sed|jq|dask|check-jsonschema|\.) "
)
FIGURE = re.compile(r"(?<![\w.])[+-]?\d+(?:\.\d+)?(?![\w.]*\w)")
MACHINES = re.compile(r"\b\d+(?:\.\d+)? (?:ms|s|min|h|MB)\b")

FIRST, OWN, USE = "docs/tutorial/first-map.md", "docs/tutorial/own-aisle.md", "docs/tutorial/use-a-map.md"
PLUGIN, SIGNS, API = "docs/writing-plugins.md", "docs/signs.md", "docs/python-api.md"
INSPECTION, BACK = "docs/inspection.md", "docs/howto/coming-back.md"
ALONE = (FIRST, OWN, PLUGIN)
"""Pages that begin with nothing but savmap's folder. To all others a reader comes with the files of `FIRST` and `OWN`, and what is lent."""
AFTER = {SIGNS: USE, API: USE, BACK: "README.md"}
"""Pages to which a reader comes with the files of another one, too."""
INSTEAD: Mapping[str, Mapping[str, str]] = {
    FIRST: {"python3 -m venv .venv && .venv/bin/pip install -e . && ": ""},
    "README.md": {
        "savmap init aisle.mp4": "savmap init aisle.mp4 --force && cp filled-in.yaml site.yaml",
        "A21-03": "'bay 2'",  # no sign hangs in the demo's aisle
    },
    USE: {"examples/scenes/signs-row.yaml": "few-frames.yaml"},
    SIGNS: {"aisle.mp4": "signs-row/footage.mp4", "--camera-height 3.05": "--camera-height 2.4"},
    PLUGIN: {"savmap simulate": "sed -i 's/frames: 40/frames: 16/' scene.yaml && savmap simulate"},
    "docs/howto/robots.md": {"  - {row: B, at: sign 3, world_m: [20.11, 6.57], sigma_m: 0.03}\n": ""},
    "docs/howto/surveys.md": {
        "points.csv --map out/map.json -o": "world.csv --map out/map.json -o",
        "points.csv --map out/map.json --align": "surveyed.csv --map out/map.json --align",
        'import_survey("points.csv"': 'import_survey("world.csv"',
    },
    "docs/live.md": {
        "aisle.mp4": "part.mp4",
        '"site.yaml"': '"part.yaml"',
        "in my_camera": "in ((one.stamp_s, one.image) for one in frames_of('part.mp4'))",
    },
    "docs/long-runs.md": {"savmap map site.yaml": "savmap map part.yaml"},
    API: {'"points.csv"': '"world.csv"', 'find(site_map, "A21-03")': 'find("out/signs", "A21-03")'},
    "docs/site-file.md": {
        "savmap init aisle1.mp4 aisle2.mp4": "savmap init aisle1.mp4 aisle2.mp4 --force && cp part.yaml site.yaml",
        "rows.A.fps=5 ": "rows.A.fps=3 ",  # the demo has six frames a second
    },
    "docs/split.md": {"-o site.yaml": "-o passes.yaml"},
    "docs/training.md": {"--count 100": "--count 4"},
}
"""What is put in the place of what, of a page: what the demo does not have, and what takes long."""
SAVED = {OWN: "site.yaml", "docs/howto/robots.md": "align.yaml"}
"""As what a reader saves the first YAML of a page."""
NOT_RUN = {
    r"^README.md: python3 .* demo$": f"{FIRST} begins with it",
    r": python3 .*pytest|: \. \.venv": ".ci/run does it to the letter",
    r": (python -m )?pip (un)?install": "it changes the environment that the tests run in",
    r"--camera (rtsp:|/dev/)": "it needs a camera",
    r"--cluster|\bdask ": "it needs a cluster, which tests/jobs/test_dask_executor.py has",
    r"savmap view out --live": "it serves until Ctrl+C; tests/report/test_live_page.py asks it",
    r": savmap (adapt|train) ": "it needs the extra `train`, and minutes",
    r": python -m (bench|savmap\w*\.lab)": "it measures, or makes pictures, for minutes to hours",
    r": check-jsonschema": "it reads a schema from the web",
    r": python -m (pip wheel|venv)|: \(cd tests": ".ci/wheels does it",
    r"^docs/hooks.md: ": "fragments of plugins",
}
"""Regular expressions of "page: command", or the first line of a page's Python, that are not run, and why."""
NOT_PRINTED = {
    "docs/howto/coming-back.md: row 1: the pass looks alike": "of a row of ten bays that are alike",
    "docs/howto/compare.md: row A: old frame moved": "of a simulated row of ten bays, on two dates",
    "docs/howto/compare.md:   the maps differ in scale": "of a camera height that is 20 cm wrong",
    "docs/live.md:   0.0 s": "of a walk at a third of the demo's pace: each machine has its own",
    "docs/verdict.md: ": "of several sites",
}
"""Blocks ```text, by page and beginning, that no command of the page prints, and what they are of."""
NEEDS = {r"rack\.dxf|as-ordered\.dxf": "cad", r"hall\.ifc": "bim", r"signs": "signs"}
"""Extras that a command needs: it is not run where they are not installed."""
EXITS = {
    "savmap map aisle.mp4 --plugins shelves,lights": (12,),
    "savmap map signs-row": (0, 12),  # of few frames: whether the end of a lamp is known differs between processors
    "savmap live ": (12,),  # as the first map of a row whose floor is plain grey
}
"""Other exit codes than 0, by the beginning of a command."""
TIMELY = re.compile(r"rows mapped: |row .*: measuring|measuring |rendering panoramas: |choosing views")
"""Lines that are printed by how long something takes."""
LEFT = re.compile(r"(?<![\w/.:-])[\w/-]+\.(?:html|csv|json|png|yaml)\b")
"""A file that a command's comment speaks of."""
VIEWS = """views:
  face: {yaw_deg: -78.2, pitch_deg: 1.8, roll_deg: -0.4, hfov_deg: 149.1}
  ceiling: {yaw_deg: 157.0, pitch_deg: 89.5, roll_deg: -124.8, hfov_deg: 70.0}
"""
"""Where savmap looks in the demo's footage: given, it is not sought again, which takes as long as measuring 30 frames."""
MONTHLY = f"""{VIEWS}plugins: {{shelves: {{}}, lights: {{}}}}
rows: {{A: {{passes: [{{video: again.mp4, side: left}}], fps: 3}}}}
"""
PART = f"""{VIEWS}plugins: {{shelves: {{}}}}
references: {{camera_height_m: {{value: 3.055, sigma: 0.02}}}}
rows: {{A: {{passes: [{{video: part.mp4, side: left}}], plugins: {{shelves: {{lowest_beam_bottom_height_m: 0.303}}}}}}}}
align: {{x_m: 12.40, y_m: 3.05, heading_deg: 3.8, sigma_m: 0.05, sigma_deg: 0.5}}
"""
ALIGN = """points:
  - {row: A, at: upright 1 / left / bottom, world_m: [12.40, 3.05], sigma_m: 0.03}
  - {row: A, at: upright 5 / right / bottom, world_m: [26.53, 3.98], sigma_m: 0.03}
"""
PYTHON = """from pathlib import Path
import savmap
from savmap.video.clip import Clip
from savmap.video.reader import panoramas as frames_of_clip
savmap.map_video = lambda video, plugins=(), **how: savmap.load_map("first")  # pages call these ten times
savmap.map_site = lambda site, plugins=(), **how: savmap.load_map("out")
site_map = Path("out/map.json").exists() and savmap.load_map("out")
frames_of = lambda video: frames_of_clip(Clip(Path(video), fps=15))
"""


@dataclass
class Step:
    """A command of a page, YAML that a reader saves as a file, or the page's Python; and what is said to be printed."""

    kind: str
    text: str
    said: list[str] = field(default_factory=list)


def text_of(page: str) -> str:
    return (ROOT / page).read_text(encoding="utf-8")


def steps_of(page: str) -> list[Step]:
    """What a reader of a page does, in order; Python last."""
    text = text_of(page)
    for old, new in INSTEAD.get(page, {}).items():
        assert old in text, f"{page} has no {old!r}"
        text = text.replace(old, new)
    steps: list[Step] = []
    python: list[str] = []
    for block in re.findall(r"^```(?s:.*?)^```$|(?:^    .*\n)+", text, re.MULTILINE):
        language, _, inside = block.removesuffix("```").partition("\n")
        if not block.startswith("```"):
            lines = textwrap.dedent(block).replace("\\\n", " ").splitlines()
            for line in lines if PROGRAM.match(lines[0]) else ():
                if PROGRAM.match(line):
                    steps.append(Step("command", line))
                elif not line.lstrip().startswith("#"):
                    steps[-1].said.append(line)
        elif language == "```python":
            python.append(inside)
        elif language == "```yaml":
            steps.append(Step("file", inside))
        elif language == "```text" and not any(f"{page}: {inside}".startswith(known) for known in NOT_PRINTED):
            steps[-1].said += inside.splitlines()
    return [*steps, Step("python", "\n".join(python))] if python else steps


def why_not(page: str, step: Step) -> str | None:
    """Why a step is not run."""
    reasons = [why for what, why in NOT_RUN.items() if re.search(what, f"{page}: {step.text.splitlines()[0]}")]
    reasons += [f"needs {one}" for what, one in NEEDS.items() if re.search(what, step.text) and not installed(one)]
    reasons += ["needs jq"] if step.text.startswith("jq ") and not shutil.which("jq") else []
    return reasons[0] if reasons else None


def differences(said: Sequence[str], printed: Sequence[str]) -> str | None:
    """The lines, from one `...` to the next, that were said to be printed and were not; None where all were."""
    chunks = [chunk.splitlines() for chunk in re.split(r"^\s*\.\.\.$\n?", "\n".join(said), flags=re.MULTILINE)]
    at = 0
    for number, chunk in enumerate(chunks):
        latest = len(printed) - len(chunk)
        places = range(latest if number == len(chunks) - 1 else at, (at if number == 0 else latest) + 1)
        fits = (place for place in places if at <= place <= latest and all(map(agrees, chunk, printed[place:])))
        if (found := next(fits, None)) is None:
            return "\n".join(chunk) or "nothing more"
        at = found + len(chunk)
    return None


def agrees(said: str, printed: str) -> bool:
    """Whether a line is as it was said to be, with figures that agree; times and sizes in memory are another machine's."""
    said, printed = (MACHINES.sub("any", line.strip()) for line in (said, printed))
    texts = (re.escape(text).replace(r"\.\.\.", ".*") for text in FIGURE.split(said))
    pattern = f"({FIGURE.pattern})".join(re.sub(r"(?:\\ )+", r"\\s+", text) for text in texts)
    match = re.fullmatch(pattern, printed)
    return match is not None and all(map(close, FIGURE.finditer(said), match.groups()))


def close(said: "re.Match[str]", printed: str) -> bool:
    """Whether a figure is as it was said to be; whole millimetres and centimetres may be one off."""
    value, decimals = float(said[0]), len(said[0].partition(".")[2])
    if decimals:
        return abs(float(printed) - value) <= max(5.001 * 10**-decimals, 0.1 * abs(value))
    length = re.match(r"(?:, [\d.]+)* [cm]m\b", said.string[said.end() :])
    return abs(float(printed) - value) <= (max(1.0, value / 5) if length else abs(value) / 50)


def files_of(command: str) -> list[str]:
    """The files that a command is to leave: what follows -o and its like, and what its comment speaks of."""
    words, _, comment = command.partition(" #")
    return [*re.findall(r" (?:-o|--sheet|--box-plot|--json) ([\w./-]+\w/?)", words), *LEFT.findall(comment)]


class Reader:
    """Somebody who does what a page says, in a folder of their own, and notes where it is not so."""

    def __init__(self, page: str, home: Path) -> None:
        self.page, self.home, self.folder = page, home, home
        self.faults: list[str] = []
        self.took: list[str] = []

    def read(self) -> "Reader":
        """Save the page's file, then do what it says, in order."""
        steps = steps_of(self.page)
        if self.page in SAVED:
            text = next(step.text for step in steps if step.kind == "file")
            (self.folder / SAVED[self.page]).write_text(text, encoding="utf-8")
        for step in steps:
            if step.text.startswith("python -m pip install -e"):
                self.install()
            elif step.kind != "file" and not why_not(self.page, step):
                self.do(step)
        return self

    def do(self, step: Step) -> None:
        """Run a command, or Python, and note what is not as the page says."""
        command = [sys.executable, "-c", PYTHON + step.text]
        if step.kind == "command":
            leave = f"trap 'pwd > {shlex.quote(str(self.home / '.folder'))}' EXIT"
            command = ["bash", "-euo", "pipefail", "-c", f"{leave}\n{step.text}"]
        begin = time.monotonic()
        pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT}
        done = subprocess.run(
            command, cwd=self.folder, env=self.surroundings(), text=True, encoding="utf-8", check=False, **pipes
        )
        self.took.append(f"{time.monotonic() - begin:6.1f} s  {step.text}\n{textwrap.indent(done.stdout, ' ' * 10)}")
        printed = [line for line in done.stdout.splitlines() if not TIMELY.match(line)]
        expected = next((codes for what, codes in EXITS.items() if step.text.startswith(what)), (0,))
        if done.returncode not in expected:
            self.faults.append(f"{step.text}\nends with exit code {done.returncode}, not {expected}:\n{done.stdout}")
        elif step.said and (missing := differences(step.said, printed)):
            self.faults.append(f"{step.text}\ndoes not print:\n{missing}\nbut:\n{done.stdout}")
        if step.kind == "command":
            self.folder = Path((self.home / ".folder").read_text(encoding="utf-8").strip())
            self.faults += [f"{step.text}\nleaves no {name}" for name in files_of(step.text) if not self.has(name)]

    def has(self, name: str) -> bool:
        """Whether there is a file, here or among results."""
        return any((folder / name).exists() for folder in (self.folder, self.folder / "out", ROOT / "docs"))

    def install(self) -> None:
        """What pip does for a plugin's project, at a place of its own."""
        content = tomllib.loads((self.folder / "pyproject.toml").read_text(encoding="utf-8"))["project"]
        package = next((self.folder / "src").iterdir())
        facts = self.home / ".installed" / f"{package.name}-{content['version']}.dist-info"
        facts.mkdir(parents=True)
        (facts.parent / package.name).symlink_to(package)
        lines = [
            line
            for group, points in content["entry-points"].items()
            for line in (f"[{group}]", *(f"{name} = {at}" for name, at in points.items()))
        ]
        (facts / "entry_points.txt").write_text("\n".join(lines), encoding="utf-8")
        (facts / "METADATA").write_text(f"Name: {content['name']}\nVersion: {content['version']}\n", encoding="utf-8")

    def surroundings(self) -> dict[str, str]:
        """The environment of a user whose home this is, with what stands beside this Python first on the path."""
        path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
        kept = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
        return kept | {
            "PATH": path,
            "HOME": str(self.home),
            "PYTHONPATH": str(self.home / ".installed"),
            "PYTHONPYCACHEPREFIX": str(self.home.parent / "pycache"),  # compiled once, and nothing beside the sources
            "PYTHONUNBUFFERED": "1",
            "BROWSER": "true",
            "COLUMNS": "200",
        }


class Library:
    """The pages that readers read, two at a time."""

    def __init__(self, folder: Path, pages: Sequence[str]) -> None:
        self.folder, self.pool = folder, ThreadPoolExecutor(2)
        self.readers: dict[str, Future[Reader]] = {}
        first = [page for page in (FIRST, OWN) if page in pages or set(pages) - {*ALONE}]
        first += [before for page, before in AFTER.items() if page in pages]
        for page in dict.fromkeys([*first, *pages]):
            if page not in ALONE and not hasattr(self, "lent"):
                self.lent = self.pool.submit(self.lend)
            self.readers[page] = self.pool.submit(self.read, page)

    def read(self, page: str) -> Reader:
        """What became of a page, in a copy of the folder with which it begins."""
        home = self.folder / page.replace("/", "-").removesuffix(".md")
        if page in AFTER:
            shutil.copytree(self.readers[AFTER[page]].result().home, home, symlinks=True)
        elif page not in ALONE:
            shutil.copytree(self.lent.result(), home, symlinks=True)
        else:
            links = {
                "savmap/demo": SITE.parent,
                "examples": ROOT / "examples",
                ".venv/bin": Path(sys.executable).parent,
            }
            for link, to in links.items():
                (home / link).parent.mkdir(parents=True, exist_ok=True)
                (home / link).symlink_to(to)
        return Reader(page, home).read()

    def lend(self) -> Path:
        """The folder that a reader of `FIRST` and `OWN` has, and what other pages take for granted."""
        home, own = self.folder / "lent", self.readers[OWN].result().home
        shutil.copytree(own, home, symlinks=True)
        shutil.copytree(self.readers[FIRST].result().home / "out" / "demo", home / "out" / "demo")
        for folder in ("spring", "autumn", "out/spring", "out/autumn"):
            shutil.copytree(own / "out", home / folder)
        for name in ("aisle1.mp4", "aisle2.mp4"):
            os.link(home / "aisle.mp4", home / name)
        for name, seconds in {"again.mp4": 9.0, "recording.mp4": 9.0, "part.mp4": 6.0}.items():
            first_seconds(home / "aisle.mp4", home / name, seconds)
        (home / "pictures").mkdir()
        for panorama in islice(panoramas(Clip(home / "aisle.mp4", fps=15)), 24):
            Image.fromarray(panorama.image).save(home / "pictures" / f"{panorama.frame:04d}.jpg", quality=95)
        signs = (ROOT / "examples" / "scenes" / "signs-row.yaml").read_text(encoding="utf-8")
        few = signs.replace("frames: 36, width: 3072", "frames: 14, width: 2048")
        site = (home / "site.yaml").read_text(encoding="utf-8")
        for name, text in {
            "filled-in": site,
            "part": PART,
            "monthly": MONTHLY,
            "align": ALIGN,
            "few-frames": few,
            "limits": next(step.text for step in steps_of(INSPECTION) if step.kind == "file"),
        }.items():
            (home / f"{name}.yaml").write_text(text, encoding="utf-8")
        surveyed(home)
        return home


def first_seconds(video: Path, part: Path, seconds: float) -> None:
    """The beginning of a video, as it is coded."""
    with av.open(str(video)) as whole, av.open(str(part), "w") as copy:
        stream = whole.streams.video[0]
        copied = copy.add_stream_from_template(stream)
        for packet in whole.demux(stream):
            if packet.pts is not None and packet.pts * packet.time_base < seconds:
                packet.stream = copied
                copy.mux(packet)


def surveyed(home: Path) -> None:
    """The demo's row as a surveyor gives it: a table in the row's frame, one in the map's world, one in that of
    align.yaml, and drawings."""
    row = json.loads((home / "survey.json").read_text(encoding="utf-8"))["rows"]["A"]
    faces = [("upright", *sides, 0.0, 8.0) for sides in row["uprights"]]
    for (_, left), (right, _), section in zip(row["uprights"], row["uprights"][1:], row["sections"], strict=False):
        faces += [("beam", left, right, *edges) for edges in section["beams"]]
    begin, end = (np.array(point["world_m"]) for point in yaml.safe_load(ALIGN)["points"])
    along = (end - begin) / np.linalg.norm(end - begin)
    frames: Mapping[str, Callable[[float, float], Sequence[float]]] = {
        "points": lambda across, up: (across, up, 0.0),
        "world": lambda across, up: (across, 0.0, up),
        "surveyed": lambda across, up: (*(begin + along * across), up),
    }
    for name, place in frames.items():
        lines = ["id,label,x,y,z"]
        for number, (label, left, right, low, high) in enumerate(faces):
            for corner in ((across, up) for across in (left, right) for up in (low, high)):
                lines.append(f"{label} {number},{label},{','.join(f'{one:.4f}' for one in place(*corner))}")
        (home / f"{name}.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    site_map = savmap.load_map(home / "out")
    if installed("cad"):
        drawing = importlib.import_module("ezdxf").new(units=6)  # metres
        for label, left, right, low, high in faces:
            outline = [(left, low), (right, low), (right, high), (left, high)]
            layer = {"upright": "POSTS", "beam": "BARS"}[label]
            drawing.modelspace().add_lwpolyline(outline, close=True, dxfattribs={"layer": layer})
        drawing.saveas(home / "rack.dxf")
        savmap.export(site_map, home / "as-ordered.dxf")
    if installed("bim"):
        savmap.export(savmap.align(site_map, home / "align.yaml"), home / "hall.ifc", "ifc")


NOTEBOOK = ROOT / "examples" / "notebooks" / "first_map.ipynb"
RUN = [page for page in PAGES if any(not why_not(page, step) for step in steps_of(page) if step.kind != "file")]


@pytest.fixture(scope="module")
def library(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Library:
    """Readers at work on all pages whose tests were asked for."""
    names = {item.name for item in request.session.items}
    asked = [page for page in RUN if f"test_page_is_true[{page}]" in names]
    if len(names & {*ON_THE_DEMO}) > 0:
        asked = list(dict.fromkeys([FIRST, OWN, *asked]))
    return Library(tmp_path_factory.mktemp("pages"), asked)


@pytest.mark.slow
@pytest.mark.parametrize("page", RUN)
def test_page_is_true(page: str, library: Library) -> None:
    reader = library.readers[page].result()
    print("\n".join(reader.took))
    assert not reader.faults, "\n\n".join(reader.faults)


SENTENCES = {
    ("README.md", r"against the survey \(about ([\d.]+) cm on average\)"): "demo: sizes, cm",
    (FIRST, r"a size\s+is off by about ([\d.]+) cm on average"): "demo: sizes, cm",
    (FIRST, r"All (\d+) uprights"): "demo: uprights",
    (FIRST, r"uprights, (\d+) beams"): "demo: beams",
    (OWN, r"has a standard deviation of about (\d+) cm along the row"): "first: end, cm",
    (OWN, r"went from about (\d+) cm to"): "first: end, cm",
    (OWN, r"cm to about (\d+) mm"): "out: end, mm",
    (OWN, r"sizes, mean absolute error \| ([\d.]+) cm"): "first: sizes, cm",
    (OWN, r"sizes, mean .*\| ([\d.]+) cm \|\n"): "out: sizes, cm",
    (OWN, r"edges along the row, largest error \| ([\d.]+) cm"): "first: V edge, cm",
    (OWN, r"edges along .*\| ([\d.]+) cm \|\n"): "out: V edge, cm",
    (OWN, r"edges above the floor, largest error \| ([\d.]+) cm"): "first: H edge, cm",
    (OWN, r"edges above .*\| ([\d.]+) cm \|\n"): "out: H edge, cm",
    (OWN, r"lamps, largest error \| ([\d.]+) cm"): "first: lights, cm",
    (OWN, r"lamps, .*\| ([\d.]+) cm \|\n"): "out: lights, cm",
}
"""Figures of sentences and tables, which agree to one unit of their last digit or a tenth, and what they are of."""


@pytest.mark.slow
def test_figures_of_sentences_are_those_of_the_maps(library: Library) -> None:
    own = library.readers[OWN].result().home
    maps = {"demo": library.readers[FIRST].result().home / "out" / "demo", "first": own / "first", "out": own / "out"}
    figures = {f"{name}: {what}": value for name, folder in maps.items() for what, value in figures_of(folder).items()}
    for (page, sentence), name in SENTENCES.items():
        match = re.search(sentence, text_of(page))
        assert match, f"{page} has no {sentence!r}"
        unit = 10.0 ** -len(match[1].partition(".")[2])
        assert float(match[1]) == pytest.approx(figures[name], rel=0.1, abs=1.001 * unit), (
            f"{page}: {match[0]} ({name})"
        )


def figures_of(folder: Path) -> dict[str, float]:
    """What sentences tell of a map of the demo's row."""
    site_map = savmap.load_map(folder)
    (row,) = site_map.rows.values()
    score = savmap.evaluate(replace(site_map, rows={"A": replace(row, name="A")}), SITE.parent / "survey.json").rows[
        "A"
    ]
    table = site_map.to_dataframe()
    end_m = table[table.vertex.str.startswith("upright 5 / right")].sigma_x_m.max()
    labels = table.drop_duplicates("structure").label.value_counts()
    largest_cm = {f"{name}, cm": 100 * np.abs(errors).max() for name, errors in score.coordinates.items()}
    return {
        "sizes, cm": 100 * np.abs(np.concatenate(list(score.errors.values()))).mean(),
        "lights, cm": 100 * np.abs(score.distances["lights"].distances_m).max(),
        "end, cm": 100 * end_m,
        "end, mm": 1000 * end_m,
        "uprights": labels["upright"],
        "beams": labels["beam"],
        **largest_cm,
    }


@pytest.fixture
def demo(library: Library, tmp_path: Path) -> Path:
    """The demo's folder as a reader of `FIRST` has it, to be changed."""
    return Path(shutil.copytree(library.readers[FIRST].result().home / "out" / "demo", tmp_path / "demo"))


@pytest.mark.slow
def test_the_notebook_runs_as_it_stands(demo: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """In the folder of the demo, so that nothing is measured again."""
    notebook, home = nbformat.read(NOTEBOOK, as_version=4), demo.parent
    begin = home / "ipython" / "profile_default" / "startup" / "folder.py"
    begin.parent.mkdir(parents=True)
    made = f"import tempfile\ntempfile.mkdtemp = lambda *how, made=tempfile.mkdtemp: made(*how) if how else {str(home)!r}\n"
    begin.write_text(made, encoding="utf-8")
    monkeypatch.setenv("JUPYTER_PLATFORM_DIRS", "1")
    monkeypatch.setenv("JUPYTER_RUNTIME_DIR", str(home / "runtime"))
    monkeypatch.setenv("IPYTHONDIR", str(home / "ipython"))
    NotebookClient(notebook, timeout=3600, kernel_name="python3", resources={"metadata": {"path": home}}).execute()
    assert pictures(notebook) == 1
    assert differences(printed(nbformat.read(NOTEBOOK, as_version=4)), printed(notebook)) is None


def test_the_notebook_is_kept_with_small_outputs() -> None:
    assert pictures(nbformat.read(NOTEBOOK, as_version=4)) == 1
    assert NOTEBOOK.stat().st_size < 150_000


def printed(notebook: nbformat.NotebookNode) -> list[str]:
    """All lines that its cells print."""
    outputs = [output for cell in notebook.cells for output in cell.get("outputs", [])]
    return "".join(output.text for output in outputs if output.output_type == "stream").splitlines()


def pictures(notebook: nbformat.NotebookNode) -> int:
    """How many pictures its cells show."""
    outputs = [output for cell in notebook.cells for output in cell.get("outputs", [])]
    return sum("image/png" in output.get("data", {}) for output in outputs)


@pytest.mark.slow
def test_lamps_alone_are_mapped_on_an_earlier_maps_path(demo: Path) -> None:
    command = [sys.executable, "-m", "savmap", "map", str(SITE), "--plugins", "lights", "-o", "out"]
    done = subprocess.run(
        [*command, "--trajectory", "demo"], cwd=demo.parent, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    lamps = savmap.evaluate(demo.parent / "out", SITE.parent / "survey.json").rows["A"].distances["lights"]
    assert (len(lamps.distances_m), lamps.missing, lamps.spurious) == (5, 0, 0)
    assert lamps.distances_m.max() < 0.025  # 18 mm too high, all of them: the survey has their lower edges


ON_THE_DEMO = (
    "test_figures_of_sentences_are_those_of_the_maps",
    "test_the_notebook_runs_as_it_stands",
    "test_lamps_alone_are_mapped_on_an_earlier_maps_path",
)


def test_exceptions_are_no_more_than_needed() -> None:
    steps = {f"{page}: {step.text}": step for page in PAGES for step in steps_of(page) if step.kind != "file"}
    blocks = [f"{page}: {block}" for page in PAGES for block in text_of(page).split("```text\n")[1:]]
    assert [what for what in NOT_RUN if not any(re.search(what, step) for step in steps)] == []
    assert [name for name, step in steps.items() if step.said and any(re.search(what, name) for what in NOT_RUN)] == []
    assert [what for what in NOT_PRINTED if not any(block.startswith(what) for block in blocks)] == []


@pytest.mark.parametrize("page", PAGES)
def test_every_command_of_a_page_has_its_options(page: str) -> None:
    """Also those that are not run, and those in the middle of a sentence."""
    for line in re.findall(r"(?:^    |`|&& )(?:\S+=\S+ )?(?:\S*/)?savmap (\w[^`\n]*)", text_of(page), re.MULTILINE):
        words = line.partition(" #")[0].partition("&&")[0].split()
        command = get_command(app)
        while isinstance(command, TyperGroup):
            command = command.commands[words.pop(0)]
        known = {option for given in command.params for option in (*given.opts, *given.secondary_opts, "--help")}
        assert {word for word in words if re.match("--?[a-z]", word)} <= known, line


def test_what_is_said_is_held_against_what_is_printed() -> None:
    printed = ["row A: 99 poses", "wrote out/map.json", "wrote out/face.png", "  mean  0.18 cm", "took 31 s (+- 3 mm)"]
    assert differences(["row A: 100 poses", "...", "  mean 0.21 cm", "took 9 s (+- 2 mm)"], printed) is None
    assert differences(["...", "wrote ...", "..."], printed) is None
    assert differences(["row A: 99 poses"], printed) == "row A: 99 poses"  # more was printed
    assert differences(["...", "  mean 0.28 cm", "..."], printed) == "  mean 0.28 cm"
    assert differences(["row A: 90 poses", "..."], printed) == "row A: 90 poses"
    assert differences(["row A: 99 poses", "wrote out/face.png", "..."], printed) is not None
