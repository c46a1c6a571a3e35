"""Site files of any origin: each mistake is one line that says where, at once and in little memory."""

import os
import time
from pathlib import Path

import pytest

from savmap.errors import SiteError
from savmap.lab.scenes import SceneError
from savmap.lab.sim.scene.files import load_scene
from savmap.site.load import load_site

PASS = "passes: [{{video: a.mp4{}}}]"


def row(name: str = "A", more: str = "") -> str:
    return f"rows:\n  {name}: {{{PASS.format(more)}}}\n"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (row('".."'), "a row's name is more than dots and blanks"),
        (row('"."'), "a row's name is more than dots and blanks"),
        (row('""'), "a row's name is more than dots and blanks"),
        (row("x" * 300), "at most 100 letters"),
        (row("ü" * 30), "at most 100 letters"),
        (row('"\\e[31mred"'), "a row's name holds no control characters"),
        (row('"\\ud800"'), "site.yaml:2: not valid YAML"),
        (row(more=", start_s: 2021-13-45"), "site.yaml:2: `rows.A.passes[0].start_s`: a number is expected"),
        (row(more=", start_s: .inf"), "site.yaml:2: not valid YAML: .inf is not a finite number"),
        (row(more=", end_s: .nan"), "site.yaml:2: not valid YAML: .nan is not a finite number"),
        (row(more=", start_s: !!float abc"), "site.yaml:2: not valid YAML: 'abc' is no float"),
        (row(more=f", fps: {'1' * 3000}"), "site.yaml:2: not valid YAML: 11111111111111111111 is not a finite number"),
        ("rows: {A: {passes: [{video: " + "a/" * 1900 + "}]}}", "a path is too long"),
        ('rows: {A: {passes: [{video: "a\\0b"}]}}', "a path holds a control character"),
        ("rows: {A: {passes: [{video: " + "a" * 300 + ".mp4}]}}", "a path is too long"),
        ("rows: " + 900 * "[" + 900 * "]", "site.yaml: not valid YAML: it is nested too deeply"),
        (row() + "# x\n" * 1_000_000, "is larger than 2 MB"),
        (row() + "- 1\n", "site.yaml:3: not valid YAML"),
    ],
)
def test_a_mistake_is_one_line_at_once(tmp_path: Path, text: str, words: str) -> None:
    path = tmp_path / "site.yaml"
    path.write_text(text)
    begin = time.monotonic()
    with pytest.raises(SiteError) as caught:
        load_site(path)
    said = str(caught.value)
    assert words in said
    assert "\n" not in said
    assert len(said) < 500
    assert time.monotonic() - begin < 10


def test_rows_may_be_called_as_dates(tmp_path: Path) -> None:
    path = tmp_path / "site.yaml"
    path.write_text(row("2021-02-30"))
    assert list(load_site(path).rows) == ["2021-02-30"]


def test_pipes_are_not_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "a.yaml")
    with pytest.raises(SiteError, match="is a device or a pipe, not a file"):
        load_site(tmp_path / "a.yaml")
    with pytest.raises(SceneError, match="is a device or a pipe, not a file"):
        load_scene(tmp_path / "a.yaml")


@pytest.mark.parametrize("text", ["rows: [", "cart: !!float abc\n", "seed: 2021-13-45\n", "a: &a {b: *a}\n"])
def test_a_broken_scene_is_one_line(tmp_path: Path, text: str) -> None:
    path = tmp_path / "scene.yaml"
    path.write_text(text)
    with pytest.raises(SceneError) as caught:
        load_scene(path)
    assert "\n" not in str(caught.value)
    assert str(path) in str(caught.value)


@pytest.mark.parametrize("text", [row(), "format: savmap-site\n"])
def test_a_site_file_is_no_scene(tmp_path: Path, text: str) -> None:
    (tmp_path / "site.yaml").write_text(text)
    with pytest.raises(SceneError, match="is a site file, which `savmap map` takes"):
        load_scene(tmp_path / "site.yaml")
