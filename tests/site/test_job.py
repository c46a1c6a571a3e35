"""Which plugins a job has where nobody names them."""

from pathlib import Path

import pytest

from savmap.cli.mapping import map_and_print, preview_and_print
from savmap.errors import PluginError, SiteError, StructureError
from savmap.jobs.check import check
from savmap.site.job import job_for
from savmap.types.progress import NoteCollector, SilentMonitor

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
    assert notes.lines == [line]


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
