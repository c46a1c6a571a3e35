"""What cannot be adapted is told in one line, before any work."""

from pathlib import Path

import pytest
import yaml

from savmap.errors import SavmapError, SiteError
from savmap.lab import train
from savmap.lab.adapt.records import AdaptOptions
from savmap.lab.adapt.run import adapt, job_to_adapt, plugin_of, require_one_network


@pytest.fixture
def site(tmp_path: Path) -> Path:
    rows = {name: {"passes": [{"video": f"{name}.mp4"}]} for name in ("A", "B")}
    content = {"plugins": {"boards": {}, "posts": {}}, "references": {"camera_height_m": {"value": 1.6}}, "rows": rows}
    path = tmp_path / "site.yaml"
    path.write_text(yaml.safe_dump(content))
    return path


def test_rows_are_chosen(site: Path, tmp_path: Path) -> None:
    assert list(job_to_adapt(site, tmp_path, AdaptOptions(rows=["B"]), ()).site.rows) == ["B"]
    with pytest.raises(SiteError, match="--row C: there is no such row; rows are A, B"):
        job_to_adapt(site, tmp_path, AdaptOptions(rows=["C"]), ())


def test_plugin_must_be_clear(site: Path, tmp_path: Path) -> None:
    job = job_to_adapt(site, tmp_path, AdaptOptions(), ())
    assert plugin_of(job, "boards") == "boards"
    with pytest.raises(SiteError, match="say whose network to teach: --plugin boards or --plugin posts"):
        plugin_of(job, None)


def test_urls_are_refused(site: Path, tmp_path: Path) -> None:
    from savmap.files.urls import where

    with pytest.raises(SiteError, match="adapting needs local files"):
        job_to_adapt(site, where("memory://out"), AdaptOptions(), ())


def test_one_network_for_all_rows(monkeypatch: pytest.MonkeyPatch, site: Path, tmp_path: Path) -> None:
    from types import SimpleNamespace

    from savmap.site.job import Job

    job = job_to_adapt(site, tmp_path, AdaptOptions(), ())
    monkeypatch.setattr(Job, "opened", lambda self, row, name: SimpleNamespace(model=Path(f"{row}.onnx")))
    with pytest.raises(SiteError, match="rows use different networks of `posts`"):
        require_one_network(job, "posts")


def test_no_round_is_no_wish() -> None:
    with pytest.raises(SiteError, match="--rounds 0"):
        AdaptOptions(rounds=0)


def test_missing_extra_comes_first(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(train, "NEEDED", ("no_such_package",))
    with pytest.raises(SavmapError, match=r"install the extra with `pip install 'savmap\[train\]'`"):
        adapt(tmp_path / "no-site.yaml", tmp_path, AdaptOptions())
