"""Which plugins a job has where nobody names them."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from savmap.cli.mapping import map_and_print, preview_and_print
from savmap.errors import PluginError, SiteError, StructureError, VideoError
from savmap.jobs.check import check
from savmap.site.job import job_for
from savmap.site.preflight import require_ready
from savmap.types.progress import NoteCollector, SilentMonitor
from savmap.video.reader import probe

from ..video.made_up_video import write_recording

VIDEO = Path(__file__).parents[2] / "examples" / "aisle-dev" / "aisle-dev.mp4"
SITE = "rows: {{A: {{passes: [{{video: {}}}]}}}}\n"


@pytest.fixture
def site(tmp_path: Path) -> Path:
    """A site file that names no plugins."""
    (tmp_path / "site.yaml").write_text(SITE.format(VIDEO), encoding="utf-8")
    return tmp_path / "site.yaml"


def lack(monkeypatch: pytest.MonkeyPatch, *packages: str) -> None:
    """As if these packages were not installed."""
    monkeypatch.setattr("savmap.plugin.manager._is_there", lambda package: package not in packages)


def test_installed_plugins_are_taken_if_they_have_all_they_need(site: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for source in (VIDEO, site):
        lack(monkeypatch)
        job = job_for(source, None, Path("out"))
        assert {"lights", "shelves", "signs"} <= set(job.plugins)
        assert job.notes == (f"no plugins are named: looking for {', '.join(job.plugins)}",)
        lack(monkeypatch, "rapidocr", "zxing-cpp")
        job = job_for(source, None, Path("out"))
        assert {"lights", "shelves"} <= set(job.plugins)
        assert job.notes[0].endswith("shelves; not signs (rapidocr and zxing-cpp not installed)")


def test_a_folder_with_a_site_file_is_that_site(site: Path, tmp_path: Path) -> None:
    """Not a folder of pictures."""
    job = job_for(tmp_path, None, Path("out"))
    assert job.source == site
    assert list(job.site.rows) == ["A"]


KINDS = {
    "ts": "libx264",
    "m2ts": "libx264",
    "webm": "libvpx-vp9",
    "mxf": "mpeg2video",
    "asf": "wmv2",
    "flv": "flv1",
    "mpg": "mpeg2video",
    "ogv": "libvpx",
    "nut": "mpeg4",
    "avi": "mpeg4",
    "mkv": "libx264",
    "mov": "libx264",
}


@pytest.mark.parametrize("suffix", KINDS)
def test_footage_is_known_by_what_it_holds(tmp_path: Path, suffix: str) -> None:
    """In every container that docs/video.md lists, whatever the file is called."""
    source = write_recording(tmp_path / f"made.{suffix}", 5, KINDS[suffix])
    for name in (f"a.{suffix}", "a.360", "a", "site.yaml"):
        source = source.rename(tmp_path / name)
        job = job_for(source, ["lights"], Path("out"), camera_height_m=3.0, side="left")
        assert job.site.rows["1"].passes[0].video == source
        assert probe(source).width == 128


@pytest.mark.parametrize("name", ["site.txt", "site", "aisle.mp4", "site.yaml"])
def test_a_site_file_is_known_by_what_it_holds(tmp_path: Path, name: str) -> None:
    for mark in ("", "\ufeff"):
        (tmp_path / name).write_text(mark + SITE.format(VIDEO), encoding="utf-8")
        job = job_for(tmp_path / name, None, Path("out"))
        assert job.site.rows["A"].passes[0].video == VIDEO
    with pytest.raises(SiteError, match="--camera-height and --side go with a video"):
        job_for(tmp_path / name, None, Path("out"), side="left")


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("site.yaml", SITE.format(VIDEO).encode("utf-16"), "site.yaml: cannot be read as a site file: it is not a text file"),
        ("site.yaml", "rows: {Halle für A: x}".encode("latin-1"), "site.yaml: cannot be read as a site file: it is not a text"),
        ("site.yaml", b"rows: \0", "site.yaml:"),
        ("site.yaml", b"", "site.yaml: a site file is a mapping"),
        ("a.mp4", b"<html>not found</html>", "a.mp4: is neither a site file (YAML, see docs/site-file.md) nor a video"),
    ],
)  # fmt: skip
def test_a_bad_site_file_is_told_as_one(tmp_path: Path, name: str, content: bytes, words: str) -> None:
    (tmp_path / name).write_bytes(content)
    with pytest.raises(SiteError) as caught:
        job_for(tmp_path / name, None, Path("out"))
    assert words in str(caught.value)


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("a.zip", b"PK\3\4" + bytes(300), "a.zip: not a video file of a kind that is read"),
        ("a.mp4", b"", "a.mp4: the file is empty"),
        ("none.ts", None, "none.ts: no such file or folder"),
        ("photo.jpg", cv2.imencode(".jpg", np.zeros((64, 128, 3), np.uint8))[1].tobytes(), "photo.jpg: is one picture, not a"),
    ],
)  # fmt: skip
def test_what_is_no_site_file_is_told_as_footage(tmp_path: Path, name: str, content: bytes | None, words: str) -> None:
    if content is not None:
        (tmp_path / name).write_bytes(content)
    with pytest.raises(VideoError) as caught:
        require_ready(job_for(tmp_path / name, ["lights"], tmp_path, camera_height_m=3.0))
    assert words in str(caught.value)


def test_plugins_that_are_named_are_taken_whatever_they_lack(site: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    lack(monkeypatch, "rapidocr")
    job = job_for(VIDEO, ["signs"], Path("out"))
    assert (job.plugins, job.notes) == (["signs"], ())
    site.write_text("plugins: {shelves: , signs: }\n" + site.read_text(encoding="utf-8"), encoding="utf-8")
    job = job_for(site, None, Path("out"))
    assert (job.plugins, job.notes) == (["shelves", "signs"], ())


def test_where_none_has_what_it_needs_one_must_be_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("savmap.site.job.lacking", lambda plugin: ("reader",))
    with pytest.raises(PluginError, match=r"no plugin .*; not shelves \(reader not installed\).*--plugins"):
        job_for(VIDEO, None, Path("out"))


def test_an_option_that_names_none_is_refused(site: Path) -> None:
    for refused in (lambda: job_for(site, [], Path("out")), lambda: check(site, [], Path("out"), SilentMonitor())):
        with pytest.raises(SiteError, match="--plugins: names none"):
            refused()


def test_the_user_is_told(
    site: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("savmap.cli.mapping.previews", lambda *_: iter(()))
    monkeypatch.setattr("savmap.jobs.check.of_job", lambda *_: iter(()))
    preview_and_print(job_for(site, None, tmp_path))
    (line,) = capsys.readouterr().out.splitlines()
    assert line.startswith("no plugins are named: looking for ")
    notes = NoteCollector()
    assert check(site, None, tmp_path, notes) == []
    assert notes.lines[:-2] == [line]


def test_a_run_tells_it_on_the_terminal_and_in_the_log(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def nothing(*_: object, **__: object) -> None:
        raise StructureError("enough")

    monkeypatch.setattr("savmap.jobs.map_site.map_rows_of", nothing)
    job = job_for(VIDEO, None, tmp_path, camera_height_m=3.05)
    with pytest.raises(StructureError, match="enough"):
        map_and_print(job)
    assert job.notes[0] in capsys.readouterr().err
    assert job.notes[0] in (tmp_path / "savmap.log").read_text(encoding="utf-8")
