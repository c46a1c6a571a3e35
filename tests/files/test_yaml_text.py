"""YAML of any origin: plain data with lines, within bounds, and one line for each mistake."""

import pytest
import yaml

from savmap.files.yaml_text import YamlError, document, dumped, load

BOMB = "a: &a [1, 2, 3, 4, 5, 6, 7, 8, 9]\n" + "".join(
    f"{after}: &{after} [{', '.join(9 * ['*' + before])}]\n"
    for before, after in zip("abcdefgh", "bcdefghi", strict=True)
)
MERGES = "x0: &x0 {a: 1}\n" + "".join(f"x{n + 1}: &x{n + 1} {{<<: [*x{n}, *x{n}], k{n}: 1}}\n" for n in range(40))


@pytest.mark.parametrize(
    ("text", "problem", "line"),
    [
        ("rows: " + 900 * "[" + 900 * "]", "nested too deeply", None),
        (BOMB, "more than 100000 values, with those that aliases stand for", 1),
        (MERGES, "more than 100000 values", 2),
        ("rows: &a {A: *a}", "an alias stands inside what it means", None),
        ("a: " + "1" * 3999, "is not a finite number", 1),
        ("a: 1\nb: !!float abc", "'abc' is no float", 2),
        ("a: 1.0e+400", "1.0e+400 is not a finite number", 1),
        ("a: .nan", ".nan is not a finite number", 1),
        ('a: "\\ud800"', "half a character", 1),
        ("a: !!python/object/apply:os.system [id]", "values of the kind tag:yaml.org,2002:python/object", 1),
        ("a: 1\nb: !cat x", "values of the kind !cat are not read", 2),
        ("rows:\n  ? [a, b]\n  : {}", "a key must be a text", 2),
        ("a:\n  <<: 1", "a section is expected behind <<", 2),
        ("rows:\n\tA: 1\n", "cannot start any token", 2),
        ("a: *b", "undefined alias", 1),
        ("a: 1\n---\nb: 1", "another document", 2),
        ("a: \x00", "not allowed", None),
    ],
)
def test_mistakes_are_one_line(text: str, problem: str, line: int | None) -> None:
    with pytest.raises(YamlError) as caught:
        load(text)
    assert problem in str(caught.value)
    assert "\n" not in str(caught.value)
    assert caught.value.line == line


def test_values_are_those_of_yaml_1_2() -> None:
    """015 is no octal number, 1:30 none of base 60, no and on are words, a date is a text."""
    values = load("[015, 0o17, 0x1F, 1_000, 1e3, 1:30, 2024-13-45, no, on, true, ~, '1', !!str 1]")
    assert values == [15, 15, 31, 1000, 1000.0, "1:30", "2024-13-45", "no", "on", True, None, "1", "1"]
    assert list(load("{010: 1, 10: 2, no: 3, ~: 4, 1.10: 5, 2024-01-02: 6}")) == [
        "010", "10", "no", "~", "1.10", "2024-01-02",
    ]  # fmt: skip


def test_lists_of_whole_numbers_may_lack_spaces() -> None:
    assert load("[[0,3], [1,2,3], [10, 20], [1.5,2, 3], ['0,3', '0,2']]") == [
        [0, 3], [1, 2, 3], [10, 20], [1.5, 2, 3], ["0,3", "0,2"],
    ]  # fmt: skip


def test_merges_fill_in_what_is_not_there() -> None:
    assert load("a: &a {b: 1, c: 2}\nd: &d {c: 3, e: 4}\nf: {<<: [*a, *d], e: 5}")["f"] == {"b": 1, "c": 2, "e": 5}


def test_lines_empty_keys_and_doubles() -> None:
    read = document("a: 1\nb:\n  - x: ''\n  - {y: , z: null}\na: 2\n")
    assert read.content == {"a": 2, "b": [{"x": ""}, {"y": None, "z": None}]}
    assert read.lines == {
        (): 1, ("a",): 1, ("b",): 2, ("b", 0): 3, ("b", 0, "x"): 3, ("b", 1): 4, ("b", 1, "y"): 4, ("b", 1, "z"): 4,
    }  # fmt: skip
    assert read.empty == [("b", 1, "y")]
    assert read.doubles == [(("a",), 1, 5)]
    assert document("").content is None


@pytest.mark.parametrize("flow", [False, None])
def test_what_is_dumped_is_read_alike_by_yaml_1_1_and_1_2(flow: bool | None) -> None:
    words = [
        "1:30",
        "010",
        "1_000",
        "on",
        "no",
        "y",
        "2024-01-02",
        "0x1F",
        "1e3",
        "0E0",
        "~",
        "",
        "a: b",
        "\u00fc",
        "=",
        "# x",
    ]
    content = {"z": {word: word for word in words}, "a": [1e-7, 1e22, 1.5, -3, True, None, *words], "n": {0: {}}}
    text = dumped(content, flow)
    assert not text.startswith("%")
    assert yaml.safe_load(text) == content
    assert load(text) == {**content, "n": {"0": {}}}
    assert list(yaml.safe_load(text)) == ["z", "a", "n"]
