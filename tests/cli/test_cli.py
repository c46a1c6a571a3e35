"""The command line: one clear line and the documented exit code for what a user gets wrong."""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from importlib import metadata
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
import typer

from savmap.cli import main
from savmap.cli.app import app
from savmap.cli.commands import COMMANDS, of_apps
from savmap.maps.map_file import write_map
from savmap.types import FrameTable, MapWarning, RowMap, SiteMap, Structure, Trajectory, Verdict

EXAMPLE = Path(__file__).parents[2] / "examples" / "aisle-dev"


class Ended(NamedTuple):
    """How a command line ended, and what it printed."""

    code: object
    out: str
    err: str


Savmap = Callable[..., Ended]


@pytest.fixture
def savmap(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Savmap:
    """Run command lines in a folder of their own."""
    monkeypatch.chdir(tmp_path)

    def run(*arguments: object) -> Ended:
        monkeypatch.setattr(sys, "argv", ["savmap", *map(str, arguments)])
        code: object = 0
        try:
            main()
        except SystemExit as end:
            code = end.code or 0
        return Ended(code, *capsys.readouterr())

    return run


@pytest.mark.parametrize(
    ("arguments", "code", "words"),
    [
        (["map"], 3, "site.yaml: no such site file"),
        (["map", EXAMPLE / "survey.json"], 3, "is a survey, not a site file"),
        (["map", "text.mp4"], 3, "is neither a site file (YAML, see docs/site-file.md) nor a video"),
        (["map", "noise.dat"], 4, "not a video file of a kind that is read"),
        (["check", "noise.dat"], 3, "is neither a site file (YAML, see docs/site-file.md) nor a video"),
        (["init", "noise.dat"], 4, "not a video file of a kind that is read"),
        (["split", "text.mp4"], 4, "not a video file of a kind that is read"),
        (["map", "empty.mp4"], 4, "empty"),
        (["map", "none.mp4"], 4, "no such file"),
        (["map", "noise.dat", "--plugins", "shelfs"], 5, "did you mean `shelves`"),
        (["map", "noise.dat", "--camera-height", "3050"], 3, "metres are expected"),
        (["map", "noise.dat", "--camera-height", "305"], 3, "metres are expected, between 0.1 and 50"),
        (["map", "noise.dat", "--side", "up"], 3, "`left` or `right`"),
        (["map", EXAMPLE / "aisle-dev.mp4"], 8, "scale is not known; give the camera's height"),
        (["map", "survey.yaml"], 9, "none.json: cannot be read"),
        (["map", EXAMPLE / "site.yaml", "-o", "file/out"], 9, "nothing can be written there"),
        (["map", "late.yaml"], 4, "late.yaml"),
        (["map", "model.yaml"], 6, "no such model file"),
        (["evaluate", "none.json", EXAMPLE / "survey.json"], 9, "none.json"),
        (["evaluate", EXAMPLE / "survey.json", EXAMPLE / "survey.json"], 9, "is a survey, not a map"),
        (["import", "none.csv"], 9, "none.csv: cannot be read"),
        (["import", "broken.yaml"], 9, "broken.yaml: surveys are read from .csv"),
        (["import", "points.csv", "-o", "out.json"], 9, "points.csv: line 2: x is far, not a number"),
        (["import", "points.csv", "--unit", "mile"], 3, "--unit mile: units are m, dm"),
        (["import", "points.csv", "--align", "broken.yaml"], 3, "give --map, too"),
        (["report", "none.json"], 9, "none.json: cannot be read"),
        (["view", "none.json", "--no-open"], 9, "none.json: cannot be read"),
        (["simulate", "none.yaml"], 3, "none.yaml: cannot be read as a scene file: no such file"),
        (["simulate", "broken.yaml"], 3, "broken.yaml:2: cannot be read as a scene file"),
        (["train", "shelfs", "--data", "none"], 5, "did you mean `shelves`"),
        (["train", "shelves", "--data", "none", "--class", "pole"], 3, "--class pole: give THEIRS=OURS"),
        (["label", "none.mp4", "--plugin", "shelves"], 4, "none.mp4: no such file"),
        (["label", "none.mp4", "--plugin", "shelfs"], 5, "did you mean `shelves`"),
        (["label", "none.mp4"], 3, "none.mp4: say whose pictures to label: --plugin lights or --plugin shelves"),
        (["map", "late.yaml", "--set", "rows.A.fsp=5"], 3, "--set rows.A.fsp: unknown key `rows.A.fsp`: did you mean"),
        (["check", "late.yaml", "--no-pictures"], 4, "late.yaml: 2 problems, listed above"),
        (["schema", "sites"], 3, "there is one for `site` and one for `map`"),
        (["map", "--frobnicate"], 2, "No such option"),
    ],
)
def test_mistakes_get_one_line_and_their_code(
    savmap: Savmap, tmp_path: Path, arguments: list[object], code: int, words: str
) -> None:
    (tmp_path / "text.mp4").write_text("not a video", encoding="utf-8")
    (tmp_path / "noise.dat").write_bytes(bytes(range(256)))
    (tmp_path / "empty.mp4").touch()
    (tmp_path / "file").touch()
    video = EXAMPLE / "aisle-dev.mp4"
    late = f"plugins: {{shelves: {{}}}}\nrows: {{A: {{passes: [{{video: {video}, start_s: 900}}]}}}}\n"
    (tmp_path / "late.yaml").write_text(late, encoding="utf-8")
    height = "references: {camera_height_m: {value: 3.05}}\n"
    model = f"{height}plugins: {{shelves: {{model: none.onnx}}}}\nrows: {{A: {{passes: [{{video: {video}}}]}}}}\n"
    (tmp_path / "model.yaml").write_text(model, encoding="utf-8")
    survey = f"{height}survey: none.json\nrows: {{A: {{passes: [{{video: {video}}}]}}}}\n"
    (tmp_path / "survey.yaml").write_text(survey, encoding="utf-8")
    (tmp_path / "broken.yaml").write_text("rows: [\n}", encoding="utf-8")
    (tmp_path / "points.csv").write_text("id,label,x,y\np,upright,far,1\n", encoding="utf-8")
    before = set(tmp_path.iterdir())
    ended = savmap(*arguments)
    words = words if words != "late.yaml" else "aisle-dev.mp4"
    assert (ended.code, words in ended.err.replace("\n", " ")) == (code, True), ended.err
    assert len(ended.err.splitlines()) == 1 or code == 2 or "savmap.log" in {p.name for p in tmp_path.rglob("*")}
    assert {path.name for path in set(tmp_path.iterdir()) - before} <= {"out"}
    assert {path.name for path in tmp_path.glob("out/*")} <= {"savmap.log"}


@pytest.mark.parametrize("when", ["mapping", "looking for plugins"])
def test_interrupted_says_so(when: str, savmap: Savmap, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    called = {"mapping": "savmap.cli.mapping.map_and_print", "looking for plugins": "savmap.plugin.manager.installed"}
    monkeypatch.setattr(called[when], interrupted)
    assert savmap("demo" if when == "mapping" else "plugins") == (130, "", "savmap: interrupted\n")


def test_terminated_ends_as_interrupted(savmap: Savmap, monkeypatch: pytest.MonkeyPatch) -> None:
    cleaned = []

    def terminated(*_: object) -> None:
        try:
            os.kill(os.getpid(), signal.SIGTERM)
            time.sleep(10)
        finally:
            cleaned.append(True)

    monkeypatch.setattr("savmap.cli.mapping.map_and_print", terminated)
    assert savmap("demo") == (143, "", "savmap: terminated\n")
    assert cleaned == [True]
    assert signal.getsignal(signal.SIGTERM) is signal.SIG_DFL


@pytest.mark.slow
def test_simulate_leaves_nothing_when_it_is_terminated(tmp_path: Path) -> None:
    scene = "cart: {start: [0.5, 1.2], end: [3.0, 1.2], height: 1.5, frames: 400, width: 256}\nrows: {A: {x: 0.0, z: 0.0}}\n"
    bays = "structures: {shelves: {rows: {A: {bays: [{width: 2.0, beams: [0.2, 1.2]}], height: 3.0}}}}\n"
    (tmp_path / "scene.yaml").write_text(scene + bays, encoding="utf-8")
    command = [sys.executable, "-c", "from savmap.cli import main; main()", "simulate", "scene.yaml", "-o", "made"]
    with subprocess.Popen(command, cwd=tmp_path, stderr=subprocess.PIPE, text=True) as process:
        while not any(tmp_path.glob(".made-*/footage.mp4")):
            assert process.poll() is None
            time.sleep(0.1)
        process.terminate()
        _, said = process.communicate(timeout=600)
    assert process.returncode == 143, said
    assert said.splitlines()[-1] == "savmap: terminated"
    assert {path.name for path in tmp_path.iterdir()} == {"scene.yaml", "made"}
    assert {path.name for path in tmp_path.glob("made/*")} == {"savmap.log"}


def _one_row() -> SiteMap:
    vertices = np.array([[x, y, 0.0] for y in (0.0, 5.0) for x in (0.0, 4.0)])
    labels = tuple(f"post 1 / {k}" for k in range(4))
    post = Structure("post 1", "post", vertices, np.tile(1e-6 * np.eye(3), (4, 1, 1)), labels, np.zeros((0, 2), int))
    path = Trajectory(np.zeros(0, int), np.zeros((0, 4, 4)))
    return SiteMap({"A": RowMap("A", FrameTable(np.zeros(0), ()), {}, path, {"posts": (post,)}, ())}, {})


@pytest.mark.parametrize("moment", ["fsync", "replace"])
@pytest.mark.parametrize(
    "command",
    [
        ["import", "points.csv", "--row", "A", "-o", "made.json"],
        ["export", "map.json", "--format", "ply", "-o", "made.ply"],
        ["export", "map.json", "--format", "glb", "-o", "made.glb"],
        ["compare", "map.json", "map.json", "--json", "made.json"],
        ["align", "map.json", "align.yaml", "-o", "made.json"],
    ],
)
def test_interrupted_while_writing_leaves_what_was_there(
    command: list[str], moment: str, savmap: Savmap, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    write_map(_one_row(), tmp_path / "map.json")
    places = "".join(f"  - {{row: A, at: post 1 / {k}, world_m: [{4 * k}.0, 3.0], sigma_m: 0.03}}\n" for k in (0, 1))
    (tmp_path / "align.yaml").write_text(f"points:\n{places}", encoding="utf-8")
    points = "".join(f"upright {k},upright,{2 * k + d},1,0\n" for k in (1, 2) for d in (0.0, 0.1))
    (tmp_path / "points.csv").write_text(f"id,label,x,y,z\n{points}", encoding="utf-8")
    (tmp_path / command[-1]).write_bytes(b"of yesterday")
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    monkeypatch.setattr(os, moment, interrupted)
    ended = savmap(*command)
    assert (ended.code, ended.err) == (130, "savmap: interrupted\n")
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before


def test_help_lists_the_commands_in_the_order_of_their_use(savmap: Savmap) -> None:
    lines = savmap("--help").out.partition("Commands:\n")[2].splitlines()
    heading = lines.index("With finished maps, and beside mapping:")
    assert [line.split()[0] for line in lines[: heading - 1]] == list(COMMANDS)
    assert [line.split()[0] for line in lines[heading + 1 :]] == list(of_apps())
    assert savmap().err == savmap("--help").out
    assert max(map(len, lines)) <= 80


@pytest.mark.parametrize(("name", "near"), [("expor", "export"), ("veiw", "view"), ("nope", "")])
def test_a_command_that_is_not_there_is_refused_with_the_nearest(name: str, near: str, savmap: Savmap) -> None:
    ended = savmap(name)
    assert ended.code == 2
    assert f"No such command '{name}'" in ended.err
    assert (f"'{near}'" in ended.err) is bool(near)


def test_help_needs_nothing_heavy() -> None:
    code = "import sys; from savmap.cli import main; main(); print(*sys.modules, file=sys.stderr)"
    done = subprocess.run(
        [sys.executable, "-c", code, "--help"], check=True, capture_output=True, text=True, timeout=600
    )
    assert not {"typer", "rich", "numpy", "pydantic", "pluggy"} & set(done.stderr.split())


def test_version_and_plugins_answer(savmap: Savmap) -> None:
    assert savmap("--version").out == f"savmap {metadata.version('savmap')}\n"
    listed = savmap("plugins").out
    assert "upright, beam" in listed
    assert "lights.int8.onnx" in listed
    assert "lab      savmap_signs.lab.plugin:SignsLab" in listed


def test_the_module_is_run_as_the_script_is(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "savmap", "schema", "sites"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=600, check=False)
    assert (done.returncode, done.stdout) == (3, "")
    assert done.stderr == "savmap: schema sites: there is one for `site` and one for `map`\n"


@pytest.mark.parametrize(
    "arguments",
    [
        ["map", "a" * 5000],
        ["map", "loop.yaml"],
        ["evaluate", "a" * 5000, "b"],
        ["simulate", "a" * 5000],
        ["check", "a" * 5000],
        ["align", "a" * 5000, "b", "-o", "c"],
    ],
)
def test_names_that_no_file_can_have_are_one_line(savmap: Savmap, arguments: list[str]) -> None:
    Path("loop.yaml").symlink_to("loop.yaml")
    ended = savmap(*arguments)
    assert ended.code in (3, 9)
    (line,) = ended.err.splitlines()
    assert line.startswith("savmap: ")


@pytest.mark.parametrize(
    "arguments", [["find", "upright 1"], ["export", "--format", "csv", "-o", "a.csv"], ["measure", "a", "b"]]
)
def test_a_map_is_named_by_its_folder_too(savmap: Savmap, tmp_path: Path, arguments: list[str]) -> None:
    write_map(_one_row(), tmp_path / "out" / "map.json")
    command, *more = arguments
    assert savmap(command, "out", *more) == savmap(command, "out/map.json", *more)
    assert "map.json: cannot be read (no such file" in savmap(command, ".", *more).err


@pytest.mark.parametrize(
    ("output", "frame"),
    [
        ("a.csv", "the row's own frame (metres: x along it to the right, y up, z out of the face)"),
        ("A.GLB", "the world's frame (metres, y up, as glTF has it), which is the map's own, for it is not aligned"),
    ],
)
def test_the_ending_of_an_exported_file_tells_its_format(
    output: str, frame: str, savmap: Savmap, tmp_path: Path
) -> None:
    write_map(_one_row(), tmp_path / "map.json")
    ended = savmap("export", "map.json", "-o", output)
    assert ended[:2] == (0, f"wrote {output}\ncoordinates are in {frame}\n")


def test_an_export_tells_what_the_file_does_not_show(savmap: Savmap, tmp_path: Path) -> None:
    site = _one_row()
    doubted = replace(site.rows["A"], verdict=Verdict((MapWarning("uncertain-element", ("post 1",)),)))
    write_map(replace(site, rows={"A": doubted}, failed={"B": "no scale"}), tmp_path / "map.json")
    assert savmap("export", "map.json", "-o", "posts.csv").out.splitlines() == [
        "wrote posts.csv",
        "coordinates are in the row's own frame (metres: x along it to the right, y up, z out of the face)",
        "note: 1 of 2 rows could not be mapped: B; 1 of 2 rows must be checked: A (`savmap view`, report.html)",
    ]
    assert (tmp_path / "posts.csv").read_text(encoding="utf-8").splitlines()[1].endswith(": post 1")


@pytest.mark.parametrize(
    "command", [["find", "map.json", "post 1"], ["measure", "map.json", "post 1 / 0", "post 1 / 1"]]
)
def test_figures_name_their_frame_and_rows_to_check(command: list[str], savmap: Savmap, tmp_path: Path) -> None:
    site = _one_row()
    doubted = replace(site.rows["A"], verdict=Verdict((MapWarning("uncertain-element", ("post 1",)),)))
    write_map(replace(site, rows={"A": doubted}), tmp_path / "map.json")
    ended = savmap(*command)
    *_, line, note = ended.out.splitlines()
    assert ended.code == 0
    assert note == "note: 1 of 1 row must be checked: A (`savmap view`, report.html)"
    assert line.startswith("x, y, z are in the row's own frame (metres: x along it")


def test_no_output_goes_to_the_terminal(savmap: Savmap, tmp_path: Path) -> None:
    commands: Any = typer.main.get_command(app)
    with_output = [[name] for name, command in commands.commands.items() if _has_output(command)]
    assert len(with_output) > 10
    for names in [*with_output, ["plugin", "new"]]:
        refusal = "savmap: -o -: nothing is written to the terminal; give a file or a folder\n"
        assert savmap(*names, "-o", "-", "a", "b") == (3, "", refusal), names
    assert list(tmp_path.iterdir()) == []


def _has_output(command: Any) -> bool:
    return any("-o" in option.opts for option in command.params)


def test_align_writes_the_map_where_it_stands(savmap: Savmap) -> None:
    empty = {"trajectory": [], "views": {}, "structures": {}, "references": [], "report": {}}
    content = {"format": "savmap-map", "version": 1, "units": "m", "made_by": {}, "rows": {"A": empty}}
    Path("map.json").write_text(json.dumps(content), encoding="utf-8")
    Path("align.yaml").write_text("x_m: 1.5\ny_m: 2\nheading_deg: 90\n", encoding="utf-8")
    command = ["align", "map.json", "align.yaml", "-o", "new/aligned.json"]
    lines = savmap(*command).out.splitlines()
    assert lines[0] == "wrote new/aligned.json"
    assert lines[1].startswith("the site in your world: x 1.500, y 2.000, z 0.000 m, heading 90.000 degrees")
    assert json.loads(Path("new/aligned.json").read_text(encoding="utf-8"))["aligned"]["heading_deg"] == 90.0
    Path("align.yaml").write_text(
        "align: {points: [{at: a, world_m: [1, 2]}, {at: b, world_m: [1, 2]}]}", encoding="utf-8"
    )
    assert savmap(*command) == (3, "", "savmap: align.yaml:1: `align.points[0]`: row A has no `a`\n")


@pytest.mark.parametrize("arguments", [["map", "pipe.yaml"], ["evaluate", "pipe.yaml", "x"], ["report", "pipe.yaml"]])
def test_pipes_are_refused_in_one_line(savmap: Savmap, arguments: list[str]) -> None:
    os.mkfifo("pipe.yaml")
    assert "is a device or a pipe, not a file" in savmap(*arguments).err


@pytest.mark.parametrize(
    ("command", "code", "words"),
    [
        (["export", "map.json", "--format", "glb", "-o", "map.json"], 9, "map.json: is the map itself"),
        (["export", ".", "--format", "csv", "-o", "link.csv"], 9, "link.csv: is the map itself"),
        (["export", "map.json", "--format", "glb", "-o", "file/a.glb"], 9, "a.glb: cannot be written (what would be its folder"),
        (["export", "map.json", "--format", "glb", "-o", "empty"], 9, "empty: cannot be written (is a directory)"),
        (["compare", "map.json", ".", "--json", "map.json"], 9, "map.json: is the map itself"),
        (["inspect", ".", "-o", "map.html"], 9, "map.json: would be written, and is read; give the page another name"),
        (["inspect", ".", "-o", "file/a.html"], 9, "cannot be written (what would be its folder is a file)"),
        (["compare", "map.json", ".", "-o", "a.html", "--json", "a.html"], 9, "a.html: is named for two things"),
        (["compare", "map.json", ".", "-o", "view.html", "--view"], 9, "view.html: is named for two things"),
        (["compare", "map.json", ".", "-o", "file/a.html"], 9, "a.html: cannot be written (what would be its folder is a file)"),
        (["compare", "empty", "."], 9, "empty/map.json: cannot be read (no such file or directory)"),
        (["compare", "none.json", "--json", "map.json"], 2, "Missing argument 'NEW'"),
        (["view", "empty.json", "--no-open"], 9, "empty.json: is not a map"),
        (["view", ".", "--against", "survey.json", "--no-open"], 9, "survey.json: is a survey, not a map"),
        (["align", "map.json", "survey.json", "-o", "made.json"], 3, "survey.json: is a survey, not a file with `align:`"),
        (["align", "map.json", "map.json", "-o", "made.json"], 3, "map.json: is a map, not a file with `align:`"),
        (["find", "post 1"], 9, "out/map.json: cannot be read"),
        (["find", "map.json"], 3, "map.json: the map comes first, before what is asked for: map.json ..."),
        (["find", "post 1", "map.json"], 3, "map.json: the map comes first, before what is asked for: map.json post 1"),
        (["find", "map.json", "post", "1"], 3, "post: one map is expected, then what is asked for"),
        (["measure", "post 1 / 0", "post 1 / 1", "map.json"], 3, "map.json: the map comes first, before what is asked for"),
        (["find", "map.json", ""], 3, "the name to find is empty: give an id, or what is written on a structure"),
        (["find", "map.json", "  "], 3, "the name to find is empty"),
        (["export", "map.json", "-o", "a.xyz"], 3, "a.xyz: its ending tells no format; give one with --format: colmap, csv, dxf"),
        (["export", "map.json", "-o", "a"], 3, "a: its ending tells no format"),
        (["export", "map.json", "-o", "a.json"], 3, "a.json: its ending tells no format"),
        (["measure", "map.json", "post 1 / 0", "post 1"], 3, "`post 1` is no vertex of the map; nearest: post 1 / 0"),
        (["measure", "survey.json", "post 1 / 0", "post 1 / 1"], 9, "survey.json: is a survey, not a map"),
    ],
)  # fmt: skip
def test_wrong_uses_of_a_map_write_nothing(
    command: list[str], code: int, words: str, savmap: Savmap, tmp_path: Path
) -> None:
    write_map(_one_row(), tmp_path / "map.json")
    (tmp_path / "link.csv").symlink_to("map.json")
    (tmp_path / "survey.json").write_text('{"format": "savmap-survey", "rows": {}}')
    (tmp_path / "empty.json").write_text("{}")
    (tmp_path / "empty").mkdir()
    (tmp_path / "file").touch()
    before = {path.name: path.is_file() and path.read_bytes() for path in tmp_path.rglob("*")}
    ended = savmap(*command)
    assert (ended.code, words in ended.err) == (code, True), ended.err
    assert len(ended.err.splitlines()) == 1 or code == 2
    assert {path.name: path.is_file() and path.read_bytes() for path in tmp_path.rglob("*")} == before
