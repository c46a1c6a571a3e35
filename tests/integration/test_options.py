"""Every option of the commands that map, check and compare, on footage that is kept in several parts of the journal: what it must not change
is as in the plain run, to the byte, and what it changes is looked at."""

import json
import re
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import av
import cv2
import distributed
import numpy as np
import pytest
from typer.testing import CliRunner

from savmap.apps.live import session
from savmap.apps.live.session import LiveMapping
from savmap.apps.live.sources import live_job
from savmap.cli.app import _command, app
from savmap.cli.commands import COMMANDS as CORE_COMMANDS
from savmap.cli.commands import of_apps
from savmap.errors import ChangedError, MustCheckError, NothingComparedError
from savmap.files import journal
from savmap.files.journal import Journal
from savmap.maps.map_file import read_map
from savmap.site.sections import CameraSection
from savmap.types import Floats
from savmap.video.reader import panoramas

from ..video.made_up_video import DEMO, demos_beginning, refilmed

COMMANDS = ("map", "live", "check", "inspect", "compare")
SECONDS = 8.0
"""Of the demo: nine frames, two bays."""
SITE = """
plugins: {shelves: {}}
references: {camera_height_m: 3.055}
rows:
  "1": {fps: 1, passes: [{video: aisle.mp4, side: left}]}
"""
LIMITS = "plugins: {shelves: {load_units: [{name: EUR pallet, width_m: 0.8, height_m: 1.6, across: 3, levels: [1]}]}}"
FOCAL_PX = 600 / float(np.radians(190))
LENS = f"""
  distortion_model: equidistant
  intrinsics: [{FOCAL_PX!r}, {FOCAL_PX!r}, 299.5, 299.5]
  distortion_coeffs: []
  resolution: [600, 600]
"""
LENSES = f"cam0:{LENS}cam1:{LENS}  T_cn_cnm1: [[-1, 0, 0, 0], [0, 1, 0, 0], [0, 0, -1, 0], [0, 0, 0, 1]]\n"
KEEPS_EACH_FRAME = """
from savmap.files import journal

journal.KEEP_S = 0.0
if __name__ == "__main__":
    from savmap.cli.app import main

    main()
"""
"""Also in worker processes, which run the main module."""
ENDINGS = {0, *(error.exit_code for error in (MustCheckError, ChangedError, NothingComparedError))}
ESTIMATE = re.compile(r"\babout .* (s|min|MB)\b")


@dataclass(frozen=True)
class Run:
    """What a command wrote, its exit code, what it printed, and how many times it kept frames."""

    out: Path
    code: int
    said: str
    parts: int

    @property
    def map(self) -> bytes:
        return (self.out / "map.json").read_bytes()

    @property
    def places(self) -> dict[str, Floats]:
        """The vertices (n, 3) of the row's structures, m."""
        return {part.id: part.vertices for part in read_map(self.out / "map.json").rows["1"].structures["shelves"]}


@dataclass
class Runs:
    """What each case gave, which is run once, when it is first asked for; and folders and files by the names that cases call them."""

    folder: Path
    names: dict[str, object]
    done: dict[str, Run] = field(default_factory=dict)

    def __getitem__(self, name: str) -> Run:
        if name not in self.done:
            case, out = CASES[name], self.folder / name.replace(" ", "")
            case.before(self, out)
            words = case.command.format_map(Names(self, out)).split()
            self.done[name] = apart(words, out) if case.apart else here(words, out)
            assert self.done[name].code in ENDINGS, self.done[name].said
        return self.done[name]


@dataclass
class Names:
    """What the names in a case's command stand for: its folder, a file, or the folder of another case."""

    runs: Runs
    out: Path

    def __getitem__(self, name: str) -> object:
        if name == "out":
            return self.out
        return self.runs.names[name] if name in self.runs.names else self.runs[name].out


def here(words: list[str], out: Path) -> Run:
    """A command in this process, which keeps each frame at once."""
    parts, flush = list[Journal](), Journal.flush
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(journal, "KEEP_S", 0.0)
        patch.setattr(Journal, "flush", lambda kept: (parts.append(kept), flush(kept)))
        patch.setattr(session, "PREVIEWED", 5)
        result = CliRunner().invoke(app, words)
    if result.exception is not None and not hasattr(result.exception, "exit_code") and result.exit_code != 0:
        raise result.exception
    return Run(out, getattr(result.exception, "exit_code", result.exit_code), result.output, len(parts))


def apart(words: list[str], out: Path) -> Run:
    """A command in a process of its own, of which this holds for workers, too."""
    script = out.with_suffix(".py")
    script.write_text(KEEPS_EACH_FRAME, encoding="utf-8")
    done = subprocess.run([sys.executable, script, *words], capture_output=True, text=True, timeout=1800, check=False)
    return Run(out, done.returncode, done.stdout + done.stderr, 0)


def nothing(runs: Runs, out: Path) -> None:
    """Nothing is there before."""


def plain_folder(runs: Runs, out: Path) -> None:
    """The folder of the plain run is there before."""
    shutil.copytree(runs["map"].out, out)


def part_of_a_walk(runs: Runs, out: Path) -> None:
    """A session was cut off before."""
    job = live_job(Path(str(runs.names["site"])), None, out)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(session, "PREVIEWED", 5)
        with LiveMapping(job.walked, job.row) as live:
            for panorama in panoramas(job.clip):
                live.take(panorama)
            until = time.monotonic() + 300
            while not live.measured and time.monotonic() < until:
                time.sleep(0.1)
    assert live.measured


def kept_in_parts(run: Run, runs: Runs) -> None:
    assert run.parts > 5
    assert (run.out / "face-1.jpg").is_file()
    assert list(run.out.glob("pano/*.js"))


def same_map(run: Run, runs: Runs) -> None:
    assert run.map == runs["map"].map


def mapped_again(run: Run, runs: Runs) -> None:
    same_map(run, runs)
    assert run.parts > 5
    assert json.loads((run.out / "run.json").read_text(encoding="utf-8"))["rows"]["1"]["status"] == "mapped"


def without_pictures(run: Run, runs: Runs) -> None:
    same_map(run, runs)
    assert not (run.out / "face-1.jpg").exists()
    assert not list(run.out.glob("pano/*.js"))


def same_path(run: Run, runs: Runs) -> None:
    """But for one in the last digit of the metres that map.json keeps, from which the path is read."""
    first, second = (read_map(folder / "map.json").rows["1"].trajectory for folder in (runs["map"].out, run.out))
    assert np.allclose(first.world_from_rig, second.world_from_rig, rtol=0, atol=1.1e-5)
    assert list(run.places) == list(runs["map"].places)


def updated(run: Run, runs: Runs) -> None:
    assert run.places.keys() == runs["map"].places.keys()
    assert re.search(r"^ +\d+ (not seen, \d+ )?same$", run.said, re.MULTILINE), run.said


def views_alone(run: Run, runs: Runs) -> None:
    assert [path.name for path in run.out.iterdir()] == ["views-1-pass-1.jpg"]


def recorded_alongside(run: Run, runs: Runs) -> None:
    same_map(run, runs)
    assert (run.out / "live.mcap").stat().st_size > 0


def resumed(run: Run, runs: Runs) -> None:
    same_map(run, runs)
    assert "is kept from an earlier session" in run.said


def of_the_recording(run: Run, runs: Runs) -> None:
    """Its times are rounded to milliseconds."""
    assert (run.out / "recording.mkv").is_file()
    places = runs["map"].places
    assert run.places.keys() == places.keys()
    assert all(np.allclose(vertices, places[name], atol=0.01) for name, vertices in run.places.items())


def in_rows(run: Run, runs: Runs) -> None:
    assert "rows that were filmed: " in run.said


def much_the_same_map(run: Run, runs: Runs) -> None:
    """To 3 cm: two lenses see what the panorama was made of."""
    whole = runs["map"].places
    assert set(whole) == set(run.places)
    assert max(float(np.abs(run.places[name] - whole[name]).max()) for name in whole) < 0.03


def of_a_pair(run: Run, runs: Runs) -> None:
    assert run.map == runs["map --camera"].map


def as_the_folder(run: Run, runs: Runs) -> None:
    assert run.map == runs["map, a folder"].map


def as_against(run: Run, runs: Runs) -> None:
    assert run.map == runs["map --against"].map


def findings(run: Run) -> list[str]:
    """What a check printed, but for its folder and figures that differ from run to run."""
    return [line.replace(str(run.out), "OUT") for line in run.said.splitlines() if not ESTIMATE.search(line)]


def checked(run: Run, runs: Runs) -> None:
    assert findings(run)
    assert (run.out / "views-1-pass-1.jpg").is_file()


def same_findings(run: Run, runs: Runs) -> None:
    assert findings(run) == findings(runs["check"])


def same_findings_without_pictures(run: Run, runs: Runs) -> None:
    assert findings(run) == [line.partition(", views in ")[0] for line in findings(runs["check"])]
    assert not (run.out / "views-1-pass-1.jpg").exists()


def inspected(run: Run, runs: Runs) -> None:
    assert "EUR pallet" not in (run.out / "page.html").read_text(encoding="utf-8")


def inspected_by_limits(run: Run, runs: Runs) -> None:
    page = (run.out / "page.html").read_text(encoding="utf-8")
    assert "EUR pallet" in page
    assert "survey.json" in page


def compared(run: Run, runs: Runs) -> None:
    assert run.code == 0
    assert "same" in run.said


def compared_and_written(run: Run, runs: Runs) -> None:
    lines = [line for line in run.said.splitlines() if not line.startswith("wrote ")]
    assert lines == runs["compare"].said.splitlines()
    assert {path.name for path in run.out.iterdir()} >= {"page.html", "changes.json", "map.json", "view.html"}
    assert json.loads((run.out / "changes.json").read_text(encoding="utf-8"))["level"] == 0.2


@dataclass(frozen=True)
class Case:
    """A command, and what is looked at of its run; `before`: what is done before; `apart`: whether it has a process of its own."""

    command: str
    looks: Callable[[Run, Runs], None]
    before: Callable[[Runs, Path], None] = nothing
    apart: bool = False


GIVEN = "--plugins shelves --side left --camera-height 3.055 --set fps=1"
"""What the site file says, as options."""
PAIR = "--camera fisheye-pair"
OF_A_FOLDER = "--plugins shelves --side left --camera-height 3.055 --jobs 0"
CASES = {
    "map": Case("map {site} --jobs 0 -o {out}", kept_in_parts),
    "map, by options": Case(f"map {{clip}} {GIVEN} --jobs 0 -o {{out}}", same_map),
    "map --camera": Case(f"map {{pair}} {GIVEN} {PAIR} --hfov 190 --jobs 0 -o {{out}}", much_the_same_map),
    "map --calibration": Case(f"map {{pair}} {GIVEN} {PAIR} --calibration {{lenses}} --jobs 0 -o {{out}}", of_a_pair),
    "map --fresh": Case("map {site} --fresh --jobs 0 -o {out}", mapped_again, plain_folder),
    "map --jobs": Case("map {site} --jobs 2 --no-orthophotos --no-panoramas -o {out}", without_pictures, apart=True),
    "map --cluster": Case("map {site} --cluster {cluster} -o {out}", same_map),
    "map --trajectory": Case("map {site} --trajectory {map}/map.json --jobs 0 -o {out}", same_path),
    "map --against": Case("map {site} --against {map} --row 1 --jobs 0 -o {out}", updated),
    "map --preview": Case("map {site} --preview -o {out}", views_alone),
    "map, a folder": Case(f"map {{pictures}} {OF_A_FOLDER} -o {{out}}", kept_in_parts),
    "live": Case("live {site} --pace 0 -o {out}", same_map),
    "live, by options": Case(f"live {{clip}} {GIVEN} --pace 0 --mcap -o {{out}}", recorded_alongside),
    "live --resume": Case("live {site} --pace 0 --resume -o {out}", resumed, part_of_a_walk),
    "live --camera": Case("live {site} --camera {clip} -o {out}", of_the_recording),
    "live --against": Case("live {site} --against {map} --row 1 --pace 0 -o {out}", as_against),
    "live --split": Case(f"live {{clip}} {GIVEN} --pace 0 --split -o {{out}}", in_rows),
    "live --idle": Case(f"live {{pictures}} {GIVEN} --set fps=30 --idle 0.5 -o {{out}}", as_the_folder),
    "check": Case("check {site} -o {out}", checked),
    "check, by options": Case(
        "check {site} --plugins shelves --set fps=1 --no-pictures -o {out}", same_findings_without_pictures
    ),
    "check --trajectory": Case("check {site} --trajectory {map}/map.json -o {out}", same_findings),
    "inspect": Case("inspect {map} -o {out}/page.html", inspected),
    "inspect, by options": Case(
        "inspect {map} --limits {limits} --drawing {survey} -o {out}/page.html", inspected_by_limits
    ),
    "compare": Case("compare {map} {map, by options} --exit-code", compared),
    "compare, by options": Case(
        "compare {map} {out} --level 0.2 --view --json {out}/changes.json -o {out}/page.html",
        compared_and_written,
        plain_folder,
    ),
}

NEEDS = {"live, by options": pytest.mark.extra("ros")}


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Runs]:
    folder = tmp_path_factory.mktemp("options")
    clip = demos_beginning(folder / "aisle.mp4", SECONDS)
    (folder / "site.yaml").write_text(SITE, encoding="utf-8")
    (folder / "limits.yaml").write_text(LIMITS, encoding="utf-8")
    (folder / "pictures").mkdir()
    (folder / "lenses.yaml").write_text(LENSES, encoding="utf-8")
    refilmed(clip, folder / "pair.mp4", CameraSection(model="fisheye-pair", hfov_deg=190).camera(1200, 600))
    with av.open(str(clip)) as container:
        for number, frame in enumerate(container.decode(video=0)):
            if number % 6 == 0:
                cv2.imwrite(str(folder / "pictures" / f"{number:03}.jpg"), frame.to_ndarray(format="bgr24"))
    names = {name: folder / name for name in ("site.yaml", "limits.yaml", "pictures", "aisle.mp4")}
    names |= {"site": names["site.yaml"], "limits": names["limits.yaml"], "clip": clip}
    names |= {"pair": folder / "pair.mp4", "lenses": folder / "lenses.yaml"}
    with distributed.LocalCluster(
        1, threads_per_worker=1, processes=False, protocol="tcp", dashboard_address=None
    ) as cluster:
        yield Runs(folder, {**names, "survey": DEMO.with_name("survey.json"), "cluster": cluster.scheduler_address})


@pytest.mark.slow
@pytest.mark.parametrize("name", [pytest.param(name, marks=NEEDS.get(name, ())) for name in CASES])
@pytest.mark.filterwarnings("ignore")
def test_each_option_changes_what_it_says_and_no_more(name: str, runs: Runs) -> None:
    CASES[name].looks(runs[name], runs)


@pytest.mark.parametrize("command", COMMANDS)
def test_each_option_has_a_case(command: str) -> None:
    words = {word for case in CASES.values() for word in case.command.split() if case.command.split()[0] == command}
    options = [
        {*parameter.opts, *parameter.secondary_opts}
        for parameter in _command(command, {**CORE_COMMANDS, **of_apps()}[command]).params
        if parameter.param_type_name == "option"
    ]
    assert [sorted(names) for names in options if not names & words] == []
    assert {word for word in words if word.startswith("-")} <= set().union(*options)
