"""Texts of any origin are read within bounds: nothing is waited for, and each mistake is one line."""

import os
import time
from pathlib import Path

import pytest
import yaml

from savmap.errors import OutputError
from savmap.files import yaml_text
from savmap.files.atomic import file_name, read_json, read_text

BOMB = "a: &a [1, 2, 3, 4, 5, 6, 7, 8, 9]\n" + "".join(
    f"{after}: &{after} [{', '.join(9 * ['*' + before])}]\n"
    for before, after in zip("abcdefgh", "bcdefghi", strict=True)
)
MERGES = "x0: &x0 {a: 1}\n" + "".join(f"x{n + 1}: &x{n + 1} {{<<: [*x{n}, *x{n}], k{n}: 1}}\n" for n in range(40))


@pytest.mark.parametrize(
    ("text", "problem", "line"),
    [
        ("rows: " + 5000 * "[" + 5000 * "]", "nested more than 50 deep", 1),
        ("".join(f"{' ' * n}a:\n" for n in range(1500)), "nested more than 50 deep", 51),
        (BOMB, "more than 100000 values, with those that aliases stand for", 6),
        (MERGES, "more than 100000 values", 15),
        ("rows: &a {A: *a}", "the alias *a stands inside what it means", 1),
        ("- 1\n" * 100_001, "more than 100000 values", 100_000),
        ("a: 1\nb: " + "x" * 5000, "a text has 5000 letters; at most 4000", 2),
        ("a: " + "1" * 3999, "is not a finite number", 1),
        ("a: 1\nb: !!float abc", "'abc' is no float", 2),
        ("a: 1.0e+400", "1.0e+400 is not a finite number", 1),
        ("a: .nan", ".nan is not a finite number", 1),
        ('a: "\\ud800"', "", 1),
        ("a: !!python/object/apply:os.system [id]", "could not determine a constructor", 1),
        ("\ud800: 1", "it holds half a character", None),
    ],
)
def test_yaml_is_bounded(text: str, problem: str, line: int | None) -> None:
    begin = time.monotonic()
    with pytest.raises(yaml.YAMLError) as caught:
        yaml_text.load(text)
    said, where = yaml_text.problem_of(caught.value)
    assert problem in said
    assert "\n" not in said
    assert line is None or (where is not None and abs(where - line) <= 1)
    assert time.monotonic() - begin < 10


def test_dates_are_texts_in_yaml() -> None:
    assert yaml_text.load("{2024-01-02: 2024-13-45}") == {"2024-01-02": "2024-13-45"}
    assert yaml_text.load("{a: &x {b: 1}, c: {<<: *x, d: 0.5, e: yes, f: null}}")["c"] == {
        "b": 1,
        "d": 0.5,
        "e": True,
        "f": None,
    }


@pytest.mark.parametrize(
    ("content", "problem"),
    [
        ("[" * 100_000, "nested too deeply"),
        ('{"a": 1e999}', "1e999 is too large"),
        ('{"a": -1e999}', "-1e999 is too large"),
        ('{"a": ' + "9" * 5000 + "}", "is too large"),
        ('{"a": NaN}', "NaN is not a number"),
        ('{"a": -Infinity}', "-Infinity is not a number"),
        ('{"a": ["b", {"\\uD800": 1}]}', "half a character"),
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
