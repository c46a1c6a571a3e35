"""What a file of savmap's says that it is, whole or by its beginning."""

import json
import os
from pathlib import Path

import pytest

from savmap.files.kinds import HEAD, kind_of, kind_of_file


@pytest.mark.parametrize(
    ("content", "kind"),
    [
        ({"aligned": {"x_m": 1}, "format": "savmap-map"}, "a map"),
        ({"format": "savmap-survey"}, "a survey"),
        ({"format": "savmap-poses"}, "a file of the format savmap-poses"),
        ({"format": "geojson"}, ""),
        ({"format": 3}, ""),
        ({}, ""),
        ([{"format": "savmap-map"}], ""),
        ("savmap-map", ""),
    ],
)
def test_a_format_is_known_by_content_and_by_text(content: object, kind: str, tmp_path: Path) -> None:
    path = tmp_path / "any.json"
    path.write_text(json.dumps(content, indent=1))
    assert (kind_of(content), kind_of_file(path)) == (kind, kind)


def test_prose_about_formats_is_not_one(tmp_path: Path) -> None:
    path = tmp_path / "formats.md"
    path.write_text('# Formats\n\n    {"format": "savmap-map"}\n')
    assert kind_of_file(path) == ""


def test_large_files_are_known_by_their_beginning(tmp_path: Path) -> None:
    path = tmp_path / "map.json"
    path.write_text('{"format": "savmap-map", "rows": "' + 2 * HEAD * "x" + '"}')
    assert kind_of_file(path) == "a map"
    path.write_bytes(b"\xff\x00" * HEAD)
    assert kind_of_file(path) == ""


def test_what_is_no_file_is_nothing(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    assert [kind_of_file(tmp_path / name) for name in ("pipe", ".", "none")] == ["", "", ""]
