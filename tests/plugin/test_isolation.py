"""A plugin that fails: named where it fails, and, if the site file wants so, without harm to what others map. And the
trace of it all."""

import json
import os
import pickle
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from savmap.cli.mapping import map_and_print
from savmap.errors import PluginError, PluginFailedError, PluginsLeftOutError, RowsFailedError
from savmap.plugin.isolation import failures_gathered, isolated
from savmap.plugin.scaffold.stub import stub_network
from savmap.report.site_report import plugins_of_map
from savmap.site.job import job_for
from savmap.types import FrameTable, RowMap, SiteMap, Trajectory

pytestmark = pytest.mark.slow

FRAMES = 8
HOOKS = ("render_views", "detect", "extract_features", "track", "constrain", "describe", "relate")
WAYS: dict[str, dict[str, Any]] = {
    "A": {},
    **{name: {"fails_in": hook} for name, hook in zip("BCDEFGH", HOOKS, strict=True)},
    "I": {"fails_in": "track by exit"},
    "J": {"fails_in": "track by nan"},
    "K": {"fails_in": "detect", "looks": True},
}
"""By row: how `bad` fails in it. In the last one it refuses to go on because it failed."""
SAYS = {
    "I": "failed in `track`: SystemExit: 0",
    "J": "returned what cannot be used from `track`: track `bad 0`: a pixel is not finite",
}
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
        first = pass_preview.renderer.render(pass_preview.keys[0], ViewSpec("first", 0.0))
        if self.config.looks and not predict(first):
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


Ways = Mapping[str, Mapping[str, Any]]


def site(place: Path, folder: Path, mode: str, bad: Ways, good: Ways | None = None, **more: Any) -> Path:
    """A site file with settings of the plugins by row, which say how they fail."""
    content = {
        "on_plugin_error": mode,
        "references": {"camera_height_m": {"value": 1.5}, "travel_m": 2.8},
        "plugins": {"good": {}, "bad": {}},
        "rows": {
            name: {
                "passes": [{"video": str(place / "pictures"), "fps": 30.0 + number, "side": "left"}],
                "plugins": {"bad": dict(bad[name]), "good": dict((good or {}).get(name, {}))},
            }
            for number, name in enumerate(bad)
        },
        **more,
    }
    path = folder / "site.yaml"
    path.write_text(json.dumps(content), encoding="utf-8")
    return path


def run(path: Path, out: Path, jobs: int = 0) -> None:
    map_and_print(job_for(path, None, out), jobs)


def failed_rows(out: Path) -> dict[str, str]:
    return dict(json.loads((out / "map.json").read_text(encoding="utf-8"))["failed"])


def structures(out: Path, row: str, plugin: str) -> list[Any]:
    return list(json.loads((out / "map.json").read_text(encoding="utf-8"))["rows"][row]["structures"][plugin])


def says_of(name: str) -> str:
    return "plugin `bad` " + (SAYS.get(name) or f"failed in `{WAYS[name]['fails_in']}`: RuntimeError: oh")


def test_rows_are_mapped_without_the_plugin_that_fails_in_them(place: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    with pytest.raises(PluginsLeftOutError, match=r"mapped without plugins that failed: bad; .*savmap\.log") as caught:
        run(site(place, tmp_path, "skip", WAYS), out)
    assert caught.value.exit_code == 11
    rows = json.loads((out / "map.json").read_text(encoding="utf-8"))["rows"]
    runs = json.loads((out / "run.json").read_text(encoding="utf-8"))["rows"]
    log, page = ((out / name).read_text(encoding="utf-8") for name in ("savmap.log", "report.html"))
    assert "Traceback" in log
    assert list(rows) == list(WAYS)
    for name, way in WAYS.items():
        assert len(structures(out, name, "good")) == 12
        assert len(structures(out, name, "bad")) == (12 if name in "AH" else 0)
        if way:
            notes = " ".join(note for key, note in rows[name]["report"].items() if key.startswith("note"))
            start, _, end = says_of(name).partition(":")
            for text in (notes, runs[name]["plugins_failed"]["bad"], log):
                assert start in text
                assert end in text
            assert start in page


def test_structures_stay_where_only_their_relations_fail(place: Path, tmp_path: Path) -> None:
    with pytest.raises(PluginsLeftOutError):
        run(site(place, tmp_path, "skip", {"H": WAYS["H"]}), tmp_path / "out")
    for plugin, related in (("good", {"related": True}), ("bad", {})):
        attributes = [structure["attributes"] for structure in structures(tmp_path / "out", "H", plugin)]
        kept = [{key: value for key, value in each.items() if key != "unchecked_m"} for each in attributes]
        assert [{**each, "support": 1.0} for each in kept] == [{**related, "support": 1.0}] * 12


def test_otherwise_rows_fail_and_their_errors_name_plugin_and_hook(place: Path, tmp_path: Path) -> None:
    with pytest.raises(RowsFailedError):
        run(site(place, tmp_path, "fail", WAYS), tmp_path / "out")
    failed = failed_rows(tmp_path / "out")
    assert list(failed) == list(WAYS)[1:]
    for name, text in failed.items():
        start, _, end = says_of(name).partition(":")
        assert start in text
        assert end in text
    with pytest.raises(PluginFailedError, match="plugin `bad` failed in `track`: RuntimeError: oh") as caught:
        run(site(place, tmp_path, "fail", {"E": WAYS["E"]}), tmp_path / "alone")
    assert (caught.value.exit_code, caught.value.plugin, caught.value.hook) == (5, "bad", "track")


def test_a_hook_that_ends_its_process_fails_its_row(place: Path, tmp_path: Path) -> None:
    """By dying in one row, and by taking longer than the limit in another; a process in which all goes well goes on."""
    ways: Ways = {"A": {"fails_in": "track by ending the process"}, "B": {"fails_in": "describe by sleeping"}, "C": {}}
    path = site(place, tmp_path, "fail", ways, plugin_timeout_s=30)  # any hook may be slow on a busy machine
    with pytest.raises(RowsFailedError) as caught:
        run(path, tmp_path / "out", jobs=2)
    assert caught.value.exit_code == 10
    site_map = json.loads((tmp_path / "out" / "map.json").read_text(encoding="utf-8"))
    assert list(site_map["rows"]) == ["C"]
    says = "its process ended before it was mapped: out of memory, killed, crashed, or plugin_timeout_s in a hook"
    assert site_map["failed"] == {"A": says, "B": says}


@pytest.mark.parametrize("hook", ["evaluate", "draw"])
def test_a_map_is_written_scored_and_drawn_without_a_plugin_that_fails_then(
    place: Path, tmp_path: Path, hook: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("bad_fails_in", hook)
    out = tmp_path / "out"
    with pytest.raises(PluginsLeftOutError, match="plugins that failed: bad"):
        run(site(place, tmp_path, "skip", {"A": {}}, survey=str(place / "survey.json")), out)
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
    path = site(place, tmp_path, "skip", {"A": {}, "B": {}}, good={"A": {"fails_in": "render_views"}})
    with pytest.raises(RowsFailedError):
        run(path, tmp_path / "out")
    assert len(structures(tmp_path / "out", "B", "good")) == 12
    (text,) = failed_rows(tmp_path / "out").values()
    assert "plugin `good` failed in `render_views`: RuntimeError: oh; without it" in text


def test_what_lacks_a_plugin_is_not_kept(place: Path, tmp_path: Path) -> None:
    path = site(place, tmp_path, "skip", {"A": WAYS["E"], "B": {}})
    for _ in range(2):
        with pytest.raises(PluginsLeftOutError):
            run(path, tmp_path / "out")
    rows = json.loads((tmp_path / "out" / "run.json").read_text(encoding="utf-8"))["rows"]
    assert {name: row["status"] for name, row in rows.items()} == {"A": "mapped", "B": "kept"}


def test_an_error_comes_back_whole_from_another_process() -> None:
    error = pickle.loads(pickle.dumps(PluginFailedError("bad", "track", "failed in `track`: oh")))
    assert isinstance(error, PluginError)
    assert str(error) == "plugin `bad` failed in `track`: oh"
    assert error.hook == "track"


def test_calls_are_traced_in_other_processes_too(
    place: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("SAVMAP_TRACE", "1")
    paths = [str(place / "packages"), *os.environ.get("PYTHONPATH", "").split(os.pathsep)]
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(paths))
    with pytest.raises(PluginsLeftOutError):
        run(site(place, tmp_path, "skip", {"A": WAYS["G"], "B": {}}), tmp_path / "out", jobs=2)
    log, printed = (tmp_path / "out" / "savmap.log").read_text(encoding="utf-8"), capfd.readouterr().err
    for text in (printed, log):
        assert "trace: good.extract_features [row A, frame 3, pass 1 / good]: " in text
        assert "trace: good.track [row B]: " in text
        assert "12 Track" in text
        assert "trace: bad.describe [row A]: " in text
        assert "raised RuntimeError: oh" in text
    assert log.count("trace: good.track [row B]: ") == printed.count("trace: good.track [row B]: ") == 1
