"""A plugin that fails: named where it fails, and, if the site file wants so, without harm to what others map. And the trace of it all."""

import json
import os
import pickle
import subprocess
import sys
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pluggy
import pytest

from savmap.cli.mapping import map_and_print
from savmap.errors import PluginError, PluginFailedError, PluginsLeftOutError, RowsFailedError
from savmap.plugin.isolation import failures_gathered, isolated
from savmap.plugin.manager import open_plugin
from savmap.plugin.scaffold.stub import stub_network
from savmap.report.site_report import plugins_of_map
from savmap.site.job import job_for
from savmap.types import FrameTable, RowMap, SiteMap, Trajectory

pytestmark = pytest.mark.slow

IN_A_ROW = ("render_views", "detect", "extract_features", "track", "constrain", "describe")
AFTERWARDS = ("evaluate", "draw")
FRAMES = 8
PLUGINS = '''
import os
import time
from dataclasses import replace
from pathlib import Path
import numpy as np
from pydantic import BaseModel, ConfigDict
from savmap.errors import StructureError
from savmap.types import Score
from savmap.geometry.pinhole import project
from savmap.graph import Constraints, KeySpace, fixed_coordinate, image_measurements, known_coordinate, known_length
from savmap.plugin.hookspecs import hookimpl
from savmap.vision.view_planning import LEVEL
from savmap.types import ViewPlan, Detection, Feature, Structure, Track, ViewSpec

POINTS = np.array([[x, y, 0.0] for x in (0.0, 1.0, 2.0, 3.0) for y in (0.5, 1.3, 2.2)])


class Config(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)
    fails_in: str = ""
    looks: bool = False


class Good:
    """Sees points of a wall from a known path, without looking."""

    name = "good"
    classes = ("post",)
    model = Path(__file__).parent / "post.onnx"
    Config = Config
    finds_face = True

    def __init__(self, config):
        self.config = config

    def may(self, hook):
        if hook in (self.config.fails_in, os.environ.get(f"{self.name}_fails_in")):
            raise RuntimeError("oh")
        if self.config.fails_in == f"{hook} by exit":
            raise SystemExit(0)
        if self.config.fails_in == f"{hook} by ending the process":
            os._exit(0)
        if self.config.fails_in == f"{hook} by sleeping":
            time.sleep(600)

    @hookimpl
    def render_views(self, pass_preview, predict):
        self.may("render_views")
        if self.config.looks and not predict(pass_preview.renderer.render(pass_preview.keys[0], ViewSpec("first", 0.0))):
            raise StructureError("nothing is seen")
        spec = ViewSpec(self.name, 0.0, hfov_deg=110.0, width=160, height=120)
        return ViewPlan((spec,), LEVEL if self.finds_face else None, 1 if self.finds_face else 0)

    @hookimpl
    def detect(self, view):
        self.may("detect")
        return []

    @hookimpl
    def extract_features(self, view):
        self.may("extract_features")
        camera = np.array([0.4 * view.frame, 1.5, 2.5])
        pixels = project((POINTS - camera) @ LEVEL, view.spec.camera)
        inside = ((pixels > 0) & (pixels < [159, 119])).all(axis=1)
        return [
            Feature(view.frame, view.spec.name, "post", "point", int(i), pixels[i][None], np.eye(2)[None])
            for i in np.flatnonzero(inside)
        ]

    @hookimpl
    def track(self, features):
        self.may("track")
        return [self._track(i, [one for one in features if one.instance == i]) for i in range(len(POINTS))]

    def _track(self, number, own):
        pixels = np.concatenate([one.pixels for one in own])
        covariances = np.concatenate([one.covariance for one in own])
        frames = np.array([one.frame for one in own])
        if self.config.fails_in == "track by nan":
            pixels = pixels * np.nan
        name = f"{self.name} {number}"
        return Track(name, "post", {"post": number}, frames, tuple(one.view for one in own), pixels, covariances)

    @hookimpl
    def constrain(self, tracks, facts):
        self.may("constrain")
        keys = KeySpace(self.name).keys([track.name for track in tracks])
        first = {track.name: POINTS[track.place["post"]] for track in tracks}
        lowest = keys[f"{self.name} 0"]
        length = known_length("x", lowest, keys[f"{self.name} 9"], 3.0, 0.003, f"{self.name} length")
        known = (length, fixed_coordinate("x", lowest), known_coordinate("y", lowest, 0.5, 0.002, f"{self.name} height"))
        flat = tuple(fixed_coordinate("z", key) for key in keys.values())
        return Constraints(self.name, keys, image_measurements(tracks, keys, facts.views), (*flat, *known), first)

    @hookimpl
    def describe(self, tracks, solution):
        self.may("describe")
        return [self._post(track, solution.landmarks_of(self.name)[track.name]) for track in tracks]

    def _post(self, track, solved):
        empty = np.empty((0, 2), dtype=np.int64)
        return Structure(track.name, "post", solved.position[None], solved.covariance[None], ("point",), empty)

    @hookimpl
    def relate(self, structures):
        self.may("relate")
        return [replace(one, attributes={"related": True}) for one in structures]

    @hookimpl
    def cross_row_landmarks(self, structures):
        self.may("cross_row_landmarks")
        return []

    @hookimpl
    def evaluate(self, structures, survey):
        self.may("evaluate")
        return Score()

    @hookimpl
    def draw(self, structures):
        self.may("draw")
        return ()


class Bad(Good):
    name = "bad"
    finds_face = False
'''


def panorama(x: float) -> np.ndarray[Any, Any]:
    """A bare hall with stripes, (256, 512, 3), as seen by a level camera x metres along it."""
    longitude = (np.arange(512) + 0.5) / 512 * 2 * np.pi - np.pi
    latitude = np.pi / 2 - (np.arange(256) + 0.5) / 256 * np.pi
    lon, lat = np.meshgrid(longitude, latitude)
    rays = np.stack([np.cos(lat) * np.sin(lon), np.sin(lat), np.cos(lat) * np.cos(lon)], axis=-1)
    camera = np.array([x, 1.5, 0.0])
    walls = np.where(rays > 0, [8.0, 4.0, 2.5], [-5.0, 0.0, -2.5])
    ways = (walls - camera) / np.where(np.abs(rays) < 1e-9, 1e-9, rays)
    place = camera + rays * ways.min(axis=-1, keepdims=True)
    stripes = (np.floor(place * 1.3).sum(axis=-1) % 2 * 120 + 60).astype(np.uint8)
    return np.repeat(stripes[..., None], 3, axis=-1)


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with pictures, and with two plugins as they lie in site-packages."""
    folder = tmp_path_factory.mktemp("place")
    (folder / "pictures").mkdir()
    for frame in range(FRAMES):
        cv2.imwrite(str(folder / "pictures" / f"{frame:03d}.png"), panorama(0.4 * frame))
    packages = folder / "packages"
    (packages / "made_up-1.0.dist-info").mkdir(parents=True)
    points = "[savmap.plugins]\ngood = made_up_plugins:Good\nbad = made_up_plugins:Bad\n"
    (packages / "made_up-1.0.dist-info" / "entry_points.txt").write_text(points, encoding="utf-8")
    (packages / "made_up-1.0.dist-info" / "METADATA").write_text("Name: made-up\nVersion: 1.0\n", encoding="utf-8")
    (packages / "made_up_plugins.py").write_text(PLUGINS, encoding="utf-8")
    (packages / "post.onnx").write_bytes(stub_network("post", "1"))
    survey = {"format": "savmap-survey", "version": 1, "units": "m", "rows": {"A": {}, "B": {}}}
    (folder / "survey.json").write_text(json.dumps(survey), encoding="utf-8")
    return folder


@pytest.fixture(autouse=True)
def _installed(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(place / "packages"))
    monkeypatch.delitem(sys.modules, "made_up_plugins", raising=False)


def site(place: Path, folder: Path, mode: str, bad: str, rows: str = "A", scored: bool = False) -> Path:
    """A site file whose plugins fail in the hooks that are named."""
    content = {
        "on_plugin_error": mode,
        "survey": str(place / "survey.json") if scored else None,
        "references": {"camera_height_m": {"value": 1.5}, "travel_m": 2.8},
        "plugins": {"good": {}, "bad": {}},
        "rows": {
            name: {
                "passes": [{"video": str(place / "pictures"), "fps": 30.0 * (1 + number), "side": "left"}],
                "plugins": {"bad": {"fails_in": bad if name == "A" else ""}},
            }
            for number, name in enumerate(rows)
        },
    }
    path = folder / "site.yaml"
    path.write_text(json.dumps(content), encoding="utf-8")
    return path


def mapped(path: Path, out: Path, jobs: int = 0) -> dict[str, Any]:
    """The rows of map.json after a run; the run's error is raised."""
    try:
        map_and_print(job_for(path, None, out), jobs)
    finally:
        rows = json.loads((out / "map.json").read_text(encoding="utf-8"))["rows"] if (out / "map.json").exists() else {}
    return dict(rows)


def structures(out: Path, row: str, plugin: str) -> list[Any]:
    return list(json.loads((out / "map.json").read_text(encoding="utf-8"))["rows"][row]["structures"][plugin])


def test_nothing_fails_where_nothing_fails(place: Path, tmp_path: Path) -> None:
    mapped(site(place, tmp_path, "fail", ""), tmp_path / "out")
    for plugin in ("good", "bad"):
        assert len(structures(tmp_path / "out", "A", plugin)) == 12


@pytest.mark.parametrize("hook", IN_A_ROW)
def test_a_row_is_mapped_without_the_plugin_that_fails_in_it(place: Path, tmp_path: Path, hook: str) -> None:
    out = tmp_path / "out"
    path = site(place, tmp_path, "skip", hook)
    with pytest.raises(PluginsLeftOutError, match=r"mapped without plugins that failed: bad; .*savmap\.log") as caught:
        mapped(path, out)
    assert caught.value.exit_code == 11
    assert structures(out, "A", "bad") == []
    assert len(structures(out, "A", "good")) == 12
    row = json.loads((out / "map.json").read_text(encoding="utf-8"))["rows"]["A"]
    wanted = f"plugin `bad` failed in `{hook}`"
    assert [note for key, note in row["report"].items() if key.startswith("note") and wanted in note]
    assert wanted in json.loads((out / "run.json").read_text(encoding="utf-8"))["rows"]["A"]["plugins_failed"]["bad"]
    log = (out / "savmap.log").read_text(encoding="utf-8")
    assert wanted in log
    assert "Traceback" in log
    assert wanted in (out / "report.html").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("how", "says"),
    [
        ("track by exit", "failed in `track`: SystemExit: 0"),
        ("describe by exit", "failed in `describe`: SystemExit: 0"),
        ("track by nan", "returned what cannot be used from `track`: track `bad 0`: a pixel is not finite"),
    ],
)
def test_a_row_is_mapped_without_a_plugin_that_exits_or_answers_nan(
    place: Path, tmp_path: Path, how: str, says: str
) -> None:
    with pytest.raises(PluginsLeftOutError, match="plugins that failed: bad"):
        mapped(site(place, tmp_path, "skip", how), tmp_path / "out")
    assert structures(tmp_path / "out", "A", "bad") == []
    assert len(structures(tmp_path / "out", "A", "good")) == 12
    assert f"plugin `bad` {says}" in (tmp_path / "out" / "savmap.log").read_text(encoding="utf-8")
    with pytest.raises(PluginFailedError, match=f"plugin `bad` {says}"):
        mapped(site(place, tmp_path, "fail", how), tmp_path / "fail")


def test_a_hook_that_ends_its_process_fails_its_row(place: Path, tmp_path: Path) -> None:
    """By dying in one row, and by taking longer than the limit in another; a process in which all goes well goes on."""
    path = site(place, tmp_path, "fail", "track by ending the process", rows="ABC")
    content = json.loads(path.read_text(encoding="utf-8"))
    content["plugin_timeout_s"] = 8  # any hook may be slow on a busy machine
    content["rows"]["B"]["plugins"]["bad"] = {"fails_in": "describe by sleeping"}
    path.write_text(json.dumps(content), encoding="utf-8")
    with pytest.raises(RowsFailedError) as caught:
        mapped(path, tmp_path / "out", jobs=2)
    assert caught.value.exit_code == 10
    site_map = json.loads((tmp_path / "out" / "map.json").read_text(encoding="utf-8"))
    assert list(site_map["rows"]) == ["C"]
    says = "its process ended before it was {}: out of memory, killed, crashed, or plugin_timeout_s in a hook"
    assert site_map["failed"] == {"A": says.format("solved"), "B": says.format("solved")}


def test_structures_stay_where_only_their_relations_fail(place: Path, tmp_path: Path) -> None:
    with pytest.raises(PluginsLeftOutError):
        mapped(site(place, tmp_path, "skip", "relate"), tmp_path / "out")
    for plugin, related in (("good", {"related": True}), ("bad", {})):
        found = structures(tmp_path / "out", "A", plugin)
        assert len(found) == 12
        assert all({**one["attributes"], "support": 1.0} == {**related, "support": 1.0} for one in found)


def test_what_a_plugin_refuses_because_it_failed_ends_no_row(place: Path, tmp_path: Path) -> None:
    """Its network's answers fail while it looks for its views, and so it sees nothing."""
    path = site(place, tmp_path, "skip", "detect")
    content = json.loads(path.read_text(encoding="utf-8"))
    content["plugins"]["bad"]["looks"] = True
    path.write_text(json.dumps(content), encoding="utf-8")
    with pytest.raises(PluginsLeftOutError, match="plugins that failed: bad"):
        mapped(path, tmp_path / "out")
    assert len(structures(tmp_path / "out", "A", "good")) == 12
    assert "plugin `bad` failed in `detect`" in (tmp_path / "out" / "savmap.log").read_text(encoding="utf-8")


@pytest.mark.parametrize("hook", [*IN_A_ROW, "relate"])
def test_otherwise_the_row_fails_and_its_error_names_plugin_and_hook(place: Path, tmp_path: Path, hook: str) -> None:
    with pytest.raises(PluginFailedError, match=f"plugin `bad` failed in `{hook}`.*: RuntimeError: oh") as caught:
        mapped(site(place, tmp_path, "fail", hook), tmp_path / "out")
    assert (caught.value.exit_code, caught.value.plugin, caught.value.hook) == (5, "bad", hook)


@pytest.mark.parametrize("hook", AFTERWARDS)
def test_a_map_is_written_scored_and_drawn_without_a_plugin_that_fails_then(
    place: Path, tmp_path: Path, hook: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("bad_fails_in", hook)
    out = tmp_path / "out"
    with pytest.raises(PluginsLeftOutError, match="plugins that failed: bad"):
        mapped(site(place, tmp_path, "skip", "", scored=True), out)
    assert f"plugin `bad` failed in `{hook}`" in (out / "savmap.log").read_text(encoding="utf-8")
    assert len(structures(out, "A", "bad")) == 12
    assert (out / "report.html").exists()


def test_rows_are_put_together_without_what_a_plugin_shares_that_fails_then(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setenv("bad_fails_in", "cross_row_landmarks")
    empty = Trajectory(np.zeros(0, np.int64), np.zeros((0, 4, 4)))
    row = RowMap("A", FrameTable(np.zeros(0), ()), {}, empty, {"good": (), "bad": ()}, ())
    with failures_gathered() as failures:
        plugins = isolated(list(plugins_of_map(SiteMap({"A": row}, {}))["A"].values()))
        assert [plugin.cross_row_landmarks([]) for plugin in plugins] == [[], []]
    assert [(failure.plugin, failure.hook) for failure in failures] == [("bad", "cross_row_landmarks")]
    assert "plugin `bad` failed in `cross_row_landmarks`: RuntimeError: oh" in caplog.text
    with pytest.raises(PluginFailedError):
        plugins_of_map(SiteMap({"A": row}, {}))["A"]["bad"].cross_row_landmarks([])


def test_a_row_that_needs_the_plugin_fails_and_says_so_and_other_rows_do_not(place: Path, tmp_path: Path) -> None:
    path = site(place, tmp_path, "skip", "", rows="AB")
    content = json.loads(path.read_text(encoding="utf-8"))
    content["rows"]["A"]["plugins"]["good"] = {"fails_in": "render_views"}
    path.write_text(json.dumps(content), encoding="utf-8")
    with pytest.raises(RowsFailedError):
        mapped(path, tmp_path / "out")
    site_map = json.loads((tmp_path / "out" / "map.json").read_text(encoding="utf-8"))
    assert list(site_map["rows"]) == ["B"]
    assert "plugin `good` failed in `render_views`: RuntimeError: oh; without it" in site_map["failed"]["A"]


def test_what_lacks_a_plugin_is_not_kept(place: Path, tmp_path: Path) -> None:
    path = site(place, tmp_path, "skip", "track", rows="AB")
    for _ in range(2):
        with pytest.raises(PluginsLeftOutError):
            mapped(path, tmp_path / "out")
    rows = json.loads((tmp_path / "out" / "run.json").read_text(encoding="utf-8"))["rows"]
    assert {name: row["status"] for name, row in rows.items()} == {"A": "mapped", "B": "kept"}


def test_an_error_comes_back_whole_from_another_process() -> None:
    error = pickle.loads(pickle.dumps(PluginFailedError("bad", "track", "failed in `track`: oh")))
    assert isinstance(error, PluginError)
    assert str(error) == "plugin `bad` failed in `track`: oh"
    assert error.hook == "track"


def test_calls_are_traced_in_other_processes_too(place: Path, tmp_path: Path) -> None:
    path = site(place, tmp_path, "skip", "describe", rows="AB")
    command = [
        sys.executable,
        "-c",
        "from savmap.cli.app import main; main()",
        "map",
        str(path),
        "-o",
        "out",
        "--jobs",
        "2",
    ]
    paths = os.pathsep.join([str(place / "packages"), *os.environ.get("PYTHONPATH", "").split(os.pathsep)])
    done = subprocess.run(
        command,
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": paths, "SAVMAP_TRACE": "1"},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 11, done.stderr
    log = (tmp_path / "out" / "savmap.log").read_text(encoding="utf-8")
    for text in (done.stderr, log):
        assert "trace: good.extract_features [row A, frame 3, pass 1 / good]: " in text
        assert "trace: good.track [row B]: " in text
        assert "12 Track" in text
        assert "trace: bad.describe [row A]: " in text
        assert "raised RuntimeError: oh" in text
    assert log.count("trace: good.track [row B]: ") == done.stderr.count("trace: good.track [row B]: ") == 1


def test_without_a_trace_nothing_is_in_the_calls_way(monkeypatch: pytest.MonkeyPatch) -> None:
    plain = pluggy.PluginManager("savmap")
    for value in (None, "", "0"):
        monkeypatch.delenv("SAVMAP_TRACE", raising=False)
        if value is not None:
            monkeypatch.setenv("SAVMAP_TRACE", value)
        assert open_plugin("good", {}).manager._inner_hookexec == plain._inner_hookexec
    monkeypatch.setenv("SAVMAP_TRACE", "1")
    assert open_plugin("good", {}).manager._inner_hookexec != plain._inner_hookexec
