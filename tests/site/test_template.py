"""`savmap init`: what it writes is valid, as it stands and with every setting in use, and overwrites nothing."""

import json
import os
import re
import sys
from dataclasses import replace
from pathlib import Path

import pytest
import yaml

from savmap.apps.split.find import split
from savmap.errors import OutputError, SiteError, VideoError
from savmap.files.yaml_text import load
from savmap.site.load import load_site
from savmap.site.locations import SourceMap
from savmap.site.model import Site
from savmap.site.preflight import settings_problems
from savmap.site.template import start, starter_text
from savmap.video.reader import probe

NO_MAC = pytest.mark.skipif(sys.platform == "darwin", reason="macOS has UTF-8 alone in names")
EXAMPLE = (Path(__file__).parents[2] / "examples" / "aisle-dev" / "aisle-dev.mp4").resolve()


def test_it_is_valid_and_names_its_schema(tmp_path: Path) -> None:
    path = tmp_path / "new" / "site.yaml"
    list(start([], path))
    site = load_site(path)
    assert site.rows["A"].passes[0].video == tmp_path / "new" / "aisle.mp4"
    assert set(site.plugins) >= {"shelves", "lights"}
    first = path.read_text(encoding="utf-8").splitlines()[0]
    schema = json.loads((path.parent / first.removeprefix("# yaml-language-server: $schema=")).read_text())
    import jsonschema

    jsonschema.validate(yaml.safe_load(path.read_text(encoding="utf-8")), schema)


def test_every_setting_that_is_not_in_use_may_be_used(tmp_path: Path) -> None:
    path = tmp_path / "site.yaml"
    used = re.sub(r"^#((?:  )*[a-z-])", r"\1", starter_text([], tmp_path), flags=re.MULTILINE)
    assert used.count("\n#") < 20
    path.write_text(used, encoding="utf-8")
    site = load_site(path)
    assert site.references.markers
    assert site.layout
    assert site.rows["A"].place
    assert site.rows["A"].passes[0].side == "left"
    assert list(settings_problems(site, list(site.plugins), SourceMap("site.yaml"))) == []


def test_videos_become_rows_with_their_times(tmp_path: Path) -> None:
    odd = tmp_path / "a: 1 # ü.mp4"
    odd.symlink_to(EXAMPLE)
    list(start([EXAMPLE, odd], tmp_path / "site.yaml"))
    text = (tmp_path / "site.yaml").read_text(encoding="utf-8")
    rows = load_site(tmp_path / "site.yaml").rows
    assert list(rows) == ["A", "B"]
    one = rows["A"].passes[0]
    assert one.video.resolve() == EXAMPLE
    assert one.end_s == pytest.approx(18.0, abs=10)
    assert re.search(r"# \d+x\d+ \w+, \d+ frames a second", text)


@pytest.mark.parametrize("name", [pytest.param(b"a\xff.mp4", marks=NO_MAC), b"a\n.mp4", b"a\x1b.mp4"])
def test_a_name_that_no_site_file_can_hold_is_refused(tmp_path: Path, name: bytes) -> None:
    video = tmp_path / os.fsdecode(name)
    video.symlink_to(EXAMPLE)
    with pytest.raises(SiteError, match=r"no site file can name it, .* bytes that are no UTF-8: rename it$"):
        start([video], tmp_path / "site.yaml")
    with pytest.raises(SiteError, match="rename it"):
        split(video, tmp_path / "site.yaml")
    assert list(tmp_path.iterdir()) == [video]


@pytest.mark.parametrize(
    "name", ["a\u2028b", "a\u200fb", "2024-05-01", "12", "1e3", "true", "null", "on", ".inf", "a #b", '"', "..."]
)
def test_a_folder_of_pictures_may_have_any_name(tmp_path: Path, name: str) -> None:
    video = tmp_path / name
    video.symlink_to(EXAMPLE)
    list(start([video], tmp_path / "site.yaml"))
    assert load_site(tmp_path / "site.yaml").rows["A"].passes[0].video == video


def test_a_long_video_ends_within_itself(tmp_path: Path) -> None:
    long = replace(probe(EXAMPLE), duration_s=10000.197)
    assert "end_s: 10000.19\n" in starter_text([long], tmp_path)


def test_a_plugin_that_lacks_a_package_is_not_in_use(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert set(load_site(written(tmp_path)).plugins) == {"shelves", "lights", "signs"}
    monkeypatch.setattr("savmap.plugin.manager._is_there", lambda package: package != "rapidocr")
    assert "#  signs:  # rapidocr not installed\n" in written(tmp_path).read_text(encoding="utf-8")
    assert set(load_site(tmp_path / "site.yaml").plugins) == {"shelves", "lights"}


def written(folder: Path) -> Path:
    list(start([], folder / "site.yaml", force=True))
    return folder / "site.yaml"


def test_many_videos_are_numbered(tmp_path: Path) -> None:
    info = probe(EXAMPLE)
    assert list(Site.model_validate(load(starter_text([info] * 30, tmp_path))).rows)[-1] == "30"


def test_nothing_is_overwritten_unasked(tmp_path: Path) -> None:
    path, schema = tmp_path / "site.yaml", tmp_path / "site.schema.json"
    path.write_text("mine", encoding="utf-8")
    with pytest.raises(OutputError, match="is there already"):
        list(start([], path))
    assert path.read_text(encoding="utf-8") == "mine"
    assert not schema.exists()
    schema.write_text("{}", encoding="utf-8")
    with pytest.raises(OutputError, match="not savmap's"):
        list(start([], tmp_path / "other.yaml"))
    list(start([], path, force=True))
    assert load_site(path)
    list(start([], tmp_path / "other.yaml"))


def test_a_video_that_is_none_leaves_nothing(tmp_path: Path) -> None:
    with pytest.raises(VideoError):
        list(start([tmp_path / "none.mp4"], tmp_path / "site.yaml"))
    assert list(tmp_path.iterdir()) == []
