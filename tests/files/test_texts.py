"""Texts of any origin are read within bounds: nothing is waited for, and each mistake is one line."""

import os
from pathlib import Path

import pytest

from savmap.errors import OutputError, visible
from savmap.files.atomic import file_name, read_json, read_text
from savmap.files.texts import json_visible


@pytest.mark.parametrize(
    ("content", "problem"),
    [
        ("[" * 100_000, "nested too deeply"),
        ('{"a": 1e999}', "1e999 is too large"),
        ('{"a": -1e999}', "-1e999 is too large"),
        ('{"a": ' + "9" * 5000 + "}", "is too large"),
        ('{"a": NaN}', "NaN is not a number"),
        ('{"a": -Infinity}', "-Infinity is not a number"),
        ("[" + "0," * 8_000_001 + "0]", "values; at most 8000000 are read"),
    ],
)
def test_json_is_bounded(tmp_path: Path, content: str, problem: str) -> None:
    path = tmp_path / "a.json"
    path.write_text(content)
    with pytest.raises(OutputError, match=problem) as caught:
        read_json(path)
    assert str(caught.value).startswith(f"{path}: is not JSON")
    assert len(str(caught.value)) < 300


def test_whole_surrogate_pairs_are_letters(tmp_path: Path) -> None:
    (tmp_path / "a.json").write_text('"\\ud83d\\ude00"')
    assert read_json(tmp_path / "a.json") == "\U0001f600"


def test_large_files_are_not_read_to_their_end(tmp_path: Path) -> None:
    path = tmp_path / "large.json"
    with path.open("wb") as stream:
        stream.truncate(1 << 40)
    with pytest.raises(OutputError, match="is larger than 64 MB"):
        read_text(path)


@pytest.mark.parametrize("name", ["pipe", "/dev/zero", "/dev/stdin"])
def test_pipes_and_devices_are_not_waited_for(tmp_path: Path, name: str) -> None:
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(OutputError, match=r"is a device or a pipe, not a file|cannot be read"):
        read_text(tmp_path / name)


@pytest.mark.parametrize("name", [".", "..", "...", "", "/", "\ud800", "a/../b"])
def test_a_name_is_one_file_in_its_folder(name: str) -> None:
    assert file_name(name) not in ("", ".", "..")
    assert "/" not in file_name(name)


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("rtsp://user:pass@10.0.0.2:554/live: lost", "rtsp://***@10.0.0.2:554/live: lost"),
        ("rtsp:/user:pass@10.0.0.2/live", "rtsp:/***@10.0.0.2/live"),
        ("rtsp://u:p@s:s@host/a", "rtsp://***@host/a"),
        ("rtsp://u:p/s#s?s@host/a", "rtsp://***@host/a"),
        ("(https://t0ken@host/a.mp4) and s3://k:s@b/c", "(https://***@host/a.mp4) and s3://***@b/c"),
        ("rtsp://host:554/user=a&password=b&channel=1", "rtsp://host:554/user=a&password=***&channel=1"),
        ("https://h/a.mp4?X-Amz-Signature=0f&b=1", "https://h/a.mp4?X-Amz-Signature=***&b=1"),
        ("rtsp://host:554/a@b and c@d: e/f@g", "rtsp://host:554/a@b and c@d: e/f@g"),
        ("s3://bucket/a@b.mp4 /home/a:b@c", "s3://bucket/a@b.mp4 /home/a:b@c"),
    ],
)
def test_secrets_of_urls_are_shown_nowhere(text: str, shown: str) -> None:
    assert visible(text) == shown
    assert json_visible(f'["{text}", 1]') == f'["{shown}", 1]'
