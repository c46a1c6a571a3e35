"""`savmap plugin new`: a whole project under the name that was given, or one line and nothing."""

import os
import subprocess
import sys
import tokenize
import tomllib
from pathlib import Path

import onnx
import pytest
import yaml
from typer.testing import CliRunner

from savmap.cli.app import app
from savmap.errors import OutputError, SiteError
from savmap.plugin.scaffold import new_plugin
from savmap.plugin.scaffold.new import (
    LOCATES_CAMERA,
    TEMPLATE,
    project_files,
    renamed,
    require_name,
    thing_of,
    title_of,
    write_folder,
)
from savmap.vision.networks.segmenter import Segmenter

ROOT = Path(__file__).parents[2]
NOUNS = Path(__file__).with_name("nouns.txt").read_text(encoding="utf-8").split()


@pytest.fixture(scope="module", params=[False, True], ids=["needs a path", "locates the camera"])
def project(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The project of `lamp_posts`."""
    folder = tmp_path_factory.mktemp("new") / "project"
    list(new_plugin("lamp_posts", folder, locates_camera=request.param))
    return folder


def test_the_command_writes_it_beside_and_says_what_next(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    result = CliRunner().invoke(app, ["plugin", "new", "lamp_posts"], catch_exceptions=False)
    assert "cd savmap-lamp-posts && python -m pip install" in result.output
    assert (tmp_path / "savmap-lamp-posts" / "pyproject.toml").is_file()
    assert os.listdir(tmp_path) == ["savmap-lamp-posts"]


def test_everything_bears_its_name_and_nothing_that_of_the_template(project: Path) -> None:
    files = [path for path in project.rglob("*") if path.is_file()]
    assert not [path for path in files if "pillar" in str(path.relative_to(project)).lower()]
    assert not [path for path in files if b"pillar" in path.read_bytes().lower()]
    content = tomllib.loads((project / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert content["name"] == "savmap-lamp-posts"
    assert content["entry-points"]["savmap.plugins"] == {"lamp_posts": "savmap_lamp_posts.plugin:LampPosts"}
    assert content["entry-points"]["savmap.lab"] == {"lamp_posts": "savmap_lamp_posts.lab:LampPostsLab"}
    assert content["license"] == "Apache-2.0"
    assert "your choice" in (project / "pyproject.toml").read_text(encoding="utf-8")


@pytest.mark.slow
def test_their_tests_pass_as_written(tmp_path: Path) -> None:
    """Of a project of each kind, with entry points as pip would write them; .ci/wheels does the same with real
    wheels. The names mean something to pytest and to the projects' code."""
    sources = []
    for name, locates_camera in (("starts", True), ("points", False)):
        project, facts = tmp_path / name, tmp_path / f"savmap_{name}-0.1.0.dist-info"
        list(new_plugin(name, project, locates_camera))
        facts.mkdir()
        points = f"[savmap.plugins]\n{name} = savmap_{name}.plugin:{title_of(name)}\n"
        points += f"[savmap.lab]\n{name} = savmap_{name}.lab:{title_of(name)}Lab\n"
        (facts / "entry_points.txt").write_text(points, encoding="utf-8")
        (facts / "METADATA").write_text(f"Name: savmap-{name}\nVersion: 0.1.0\n", encoding="utf-8")
        sources.append(str(project / "src"))
    env = os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, [*sources, str(tmp_path), *sys.path]))}
    command = [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", "starts/tests", "points/tests"]
    command += ["-c", "starts/pyproject.toml", "--rootdir", "."]
    done = subprocess.run(command, cwd=tmp_path, env=env, capture_output=True, text=True, timeout=600, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "18 passed" in done.stdout


@pytest.mark.parametrize("folder", [TEMPLATE, LOCATES_CAMERA], ids=lambda folder: folder.name)
def test_only_class_and_package_bear_the_name(folder: Path) -> None:
    """All else that is called so is text: in code, no noun can get into another's way."""
    for path in folder.rglob("*.py"):
        with path.open("rb") as stream:
            words = {token.string for token in tokenize.tokenize(stream.readline) if token.type == tokenize.NAME}
        assert {word for word in words if "pillar" in word.lower()} <= {"Pillars", "PillarsLab", "savmap_pillars"}


def test_two_hundred_nouns_will_do(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("savmap.plugin.scaffold.new.installed", dict)
    code = (TEMPLATE / "src" / "savmap_pillars" / "lab.py").read_text(encoding="utf-8")
    assert len(set(NOUNS)) >= 200
    for name in NOUNS:
        require_name(name)
        compile(f"class {title_of(name)}: ...\n{renamed(code, name)}", name, "exec")


def test_its_network_is_sound_onnx_and_keeps_to_the_contract(project: Path) -> None:
    path = project / "src" / "savmap_lamp_posts" / "model" / "lamp_posts.onnx"
    onnx.checker.check_model(onnx.load(path), full_check=True)
    assert Segmenter(path).classes == ("lamp_post",)
    assert path.stat().st_size < 1000


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("Pillars", "such as `pillars`"),
        ("lamp-posts", "such as `lamp_posts`"),
        ("9lives", "such as `lives`"),
        ("", "give at most 40 small letters"),
        ("a__b", "such as `a_b`"),
        ("x" * 41, "at most 40"),
        ("none", "calls something `None`"),
        ("true", "`true` is a word of YAML"),
        ("nulls", "`null` is a word of YAML"),
        ("view", "calls something `View`"),
        ("goods", "calls something `Goods`"),
        ("mapping", "calls something `Mapping`"),
        ("parts", "savmap calls the points of any object `part`"),
        ("tests", "pytest takes a class `Tests` for a test"),
        ("2d", "such as `d`"),
        ("Rack-2", "such as `rack_2`"),
        ("shelves", "is installed"),
        ("../up", "such as `up`"),
    ],
)
def test_a_name_that_will_not_do_is_refused_in_one_line(name: str, words: str, tmp_path: Path) -> None:
    with pytest.raises(SiteError, match=words) as caught:
        list(new_plugin(name, tmp_path / "new"))
    assert "\n" not in str(caught.value)
    assert not list(tmp_path.iterdir())


def test_nothing_is_overwritten(tmp_path: Path) -> None:
    (tmp_path / "mine.txt").write_text("mine", encoding="utf-8")
    for folder in (tmp_path, tmp_path / "mine.txt"):
        with pytest.raises(OutputError, match="is there already, and nothing is overwritten"):
            list(new_plugin("posts", folder))
    assert (tmp_path / "mine.txt").read_text(encoding="utf-8") == "mine"
    (tmp_path / "empty").mkdir()
    list(new_plugin("posts", tmp_path / "empty"))
    assert (tmp_path / "empty" / "README.md").is_file()


def test_it_is_written_whole_or_not_at_all(tmp_path: Path) -> None:
    too_long = "x" * 300
    with pytest.raises(OutputError, match="cannot be written"):
        write_folder({"first": b"1", too_long: b"2"}, tmp_path / "new")
    assert not list(tmp_path.iterdir())


def test_what_a_single_object_is_called() -> None:
    names = {"pillars": "pillar", "glass": "glass", "bus": "bus", "lamp_posts": "lamp_post", "x": "x"}
    assert {name: thing_of(name) for name in names} == names


def test_its_scene_is_mapped_with_the_plugins_that_its_page_names(tmp_path: Path) -> None:
    """The scene has lamps: a light that nobody asked for was mapped, and the row had to be checked for it."""
    list(new_plugin("bollards", tmp_path / "new"))
    scene = yaml.safe_load((tmp_path / "new" / "scene.yaml").read_text(encoding="utf-8"))
    assert f"names the plugins: {','.join(scene['mapped'])}" in (tmp_path / "new" / "README.md").read_text(
        encoding="utf-8"
    )
    assert set(scene["mapped"]) < set(scene["structures"])


def test_the_template_is_packaged() -> None:
    content = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    wheel = content["tool"]["hatch"]["build"]["targets"]["wheel"]
    assert "savmap" in wheel["packages"]
    left_out = [ROOT / folder.lstrip("/") for folder in wheel["exclude"]]
    for template in (TEMPLATE, LOCATES_CAMERA):
        assert not any(template.is_relative_to(folder) for folder in left_out)
    assert len(project_files("posts")) == len(project_files("posts", locates_camera=True)) == 10


def test_the_option_writes_a_plugin_that_needs_no_other(tmp_path: Path) -> None:
    command = ["plugin", "new", "posts", "--locates-camera", "-o", str(tmp_path / "new")]
    assert CliRunner().invoke(app, command, catch_exceptions=False).exit_code == 0
    assert "needs_path" not in (tmp_path / "new" / "src" / "savmap_posts" / "plugin.py").read_text(encoding="utf-8")
    assert "shelves" not in (tmp_path / "new" / "scene.yaml").read_text(encoding="utf-8")
