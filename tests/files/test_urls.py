"""Footage and results at URLs of fsspec: the same map as from paths."""

from pathlib import Path

import pytest
import upath
from typer.testing import CliRunner

from savmap.cli.app import app
from savmap.errors import SiteError
from savmap.files.atomic import write_text
from savmap.files.urls import is_url, where
from savmap.video.reader import probe

EXAMPLE = Path(__file__).parents[2] / "examples" / "aisle-dev"
pytestmark = pytest.mark.filterwarnings("ignore::UserWarning")


def test_what_is_a_url_and_what_is_not() -> None:
    assert where("file:///tmp/a.mp4") == Path("/tmp/a.mp4")
    assert where("a b/c.mp4") == Path("a b/c.mp4")
    assert where("~/a.mp4") == Path.home() / "a.mp4"
    assert where("~nobody/a.mp4") == Path("~nobody/a.mp4")
    assert not is_url(where("a.mp4"))
    assert is_url(where("memory://a/b.mp4"))
    with pytest.raises(SiteError, match=r"nosuch://a: cannot be read"):
        where("nosuch://a")


def test_url_whose_package_is_missing_is_told_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    from fsspec.registry import known_implementations

    missing = {"class": "nosuch.FileSystem", "err": "Install nosuch to access it"}
    monkeypatch.setitem(known_implementations, "lacking", missing)
    with pytest.raises(SiteError, match=r"lacking://a/b: cannot be read: Install nosuch"):
        where("lacking://a/b")


@pytest.mark.slow
def test_a_map_from_url_to_url_is_that_from_path_to_path(tmp_path: Path) -> None:
    clip = upath.UPath("memory://footage/aisle.mp4")
    clip.write_bytes((EXAMPLE / "aisle-dev.mp4").read_bytes())
    assert probe(clip).width == probe(EXAMPLE / "aisle-dev.mp4").width
    for name, video in (("url", str(clip)), ("path", str(EXAMPLE / "aisle-dev.mp4"))):
        row = f"rows: {{A: {{passes: [{{video: '{video}', side: left, fps: 1, end_s: 9}}]}}}}\n"
        write_text(
            tmp_path / f"{name}.yaml",
            f"plugins: {{shelves: {{lowest_beam_bottom_height_m: [0.303, 0.175]}}}}\nreferences: {{camera_height_m: {{value: 3.05}}}}\n{row}",
        )
    there = "memory://results/one"
    for name, output in (("url", there), ("path", str(tmp_path / "out"))):
        result = CliRunner().invoke(
            app, ["map", str(tmp_path / f"{name}.yaml"), "-o", output, "--jobs", "0"], catch_exceptions=False
        )
        assert result.exit_code == 0, result.output
    for file in ("map.json", "stages/A/solved"):
        bodies = [place.joinpath(file).read_bytes() for place in (where(there), tmp_path / "out")]
        assert bodies[0].split(b"\n", 1)[1] == bodies[1].split(b"\n", 1)[1]
    for file in ("face-A.png", "report.html", "view.html", "savmap.log", "run.json"):
        assert where(f"{there}/{file}").read_bytes()
    again = CliRunner().invoke(
        app, ["map", str(tmp_path / "url.yaml"), "-o", there, "--jobs", "0"], catch_exceptions=False
    )
    assert "kept from an earlier run: row A" in again.output
