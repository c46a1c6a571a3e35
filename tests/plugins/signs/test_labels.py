"""The audit of location labels: what is swapped, double, missing or misplaced is named, and nothing else."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from savmap.errors import SiteError
from savmap.plugin.manager import LoadedPlugin, open_plugin
from savmap.types import RowInspection, Structure

PATTERN = r"A21-(?P<bay>\d{2})-(?P<level>\d)(?P<position>[A-Z])"
BAYS, LEVELS, POSITIONS = 25, 4, 3
RING = np.array([[0, 1], [1, 2], [2, 3], [3, 0]])
Signs = dict[tuple[int, int, int], Structure]


@pytest.fixture(scope="module")
def plugin() -> LoadedPlugin:
    return open_plugin("signs", {})


def rectangle(name: str, label: str, x: tuple[float, float], y: tuple[float, float], **attributes: object) -> Structure:
    corners = np.array([[x[0], y[0], 0.0], [x[1], y[0], 0], [x[1], y[1], 0], [x[0], y[1], 0]])
    return Structure(name, label, corners, 1e-6 * np.tile(np.eye(3), (4, 1, 1)), tuple("abcd"), RING, attributes)  # type: ignore[arg-type]


def slots() -> list[Structure]:
    """Bays of 2.7 m with a post of 0.1 m, levels 1.5 m from each other; the topmost is a line on its beam."""
    made = []
    for bay in range(1, BAYS + 1):
        x = 2.8 * bay, 2.8 * bay + 2.7
        made.append(rectangle(f"bay {bay}", "bay", x, (0, 4.6), bay=bay))
        for level in range(LEVELS):
            top = 1.5 * level + (1.4 if level < LEVELS - 1 else 0.0)
            made.append(rectangle(f"bay {bay} / level {level}", "level", x, (1.5 * level, top), bay=bay, level=level))
    return made


def text(bay: int, level: int, position: int) -> str:
    """The row is numbered from its right end, in steps of two, its levels from 1."""
    return f"A21-{2 * (BAYS - bay) + 1:02d}-{level + 1}{'ABC'[position]}"


def signs(confidence: float = 0.999) -> Signs:
    """A label in front of each place, on the beam under it; on the floor level, above it."""
    made = {}
    for bay in range(1, BAYS + 1):
        for level in range(LEVELS):
            for position in range(POSITIONS):
                x = 2.8 * bay + 0.9 * position + 0.4
                low = 1.5 * level - 0.08 if level else 1.2
                written = {"text": text(bay, level, position), "confidence": confidence}
                made[bay, level, position] = rectangle(
                    f"sign {len(made) + 1}", "sign", (x, x + 0.15), (low, low + 0.05), **written
                )
    return made


def written(sign: Structure, as_other: Structure) -> Structure:
    return replace(sign, attributes=as_other.attributes)


def audited(
    plugin: LoadedPlugin,
    made: Signs,
    pattern: str | None = PATTERN,
    extra: list[Structure] | None = None,
    others: dict[str, list[Structure]] | None = None,
) -> RowInspection:
    limits = plugin.limits({} if pattern is None else {"pattern": pattern}, "limits")
    return plugin.inspect([*made.values(), *(extra or [])], {"racks": slots()}, None, limits, None, others or {}, None)


def ids(made: Signs, *keys: tuple[int, int, int]) -> set[str]:
    return {made[key].id for key in keys}


def test_a_row_in_order_has_no_findings(plugin: LoadedPlugin) -> None:
    inspection = audited(plugin, signs(), extra=[rectangle("plate", "sign", (3, 4), (2, 3), text="MAX 1000 KG")])
    assert (inspection.findings, inspection.unchecked) == ((), ())
    (table,) = inspection.tables
    assert len(table.lines) == 300
    assert {line[4] for line in table.lines} == {"right"}
    assert table.lines[0][:6] == ("A21-49-1A", 1, 0, 1, "right", "A21-49-1A")


def test_ten_wrong_labels_of_three_hundred_are_named_and_nothing_else(plugin: LoadedPlugin) -> None:
    made = signs()
    right = dict(made)
    swaps = (((3, 0, 0), (4, 0, 0)), ((10, 1, 2), (10, 2, 2)), ((20, 3, 1), (7, 0, 1)))
    for first, second in swaps:
        made[first], made[second] = written(made[first], right[second]), written(made[second], right[first])
    made[12, 2, 0] = written(made[12, 2, 0], right[15, 2, 0])
    made[1, 1, 1] = replace(made[1, 1, 1], attributes={"text": "A21-77-2B", "confidence": 0.999})
    removed = ((5, 1, 0), (25, 3, 2))
    for key in removed:
        del made[key]
    findings = audited(plugin, made).findings
    by_code: dict[str, list[set[str]]] = {}
    for finding in findings:
        by_code.setdefault(finding.code, []).append(set(finding.subjects))
    assert sorted(map(sorted, by_code.pop("label-swapped"))) == sorted(sorted(ids(right, *pair)) for pair in swaps)
    assert by_code.pop("label-double") == [ids(right, (12, 2, 0), (15, 2, 0))]
    assert by_code.pop("label-misplaced") == [ids(right, (1, 1, 1))]
    assert by_code.pop("label-missing") == [{"bay 5 / level 1"}, {"bay 25 / level 3"}]
    assert by_code == {}
    titles = [finding.title for finding in findings]
    assert '"A21-77-2B" hangs where "A21-49-2B" belongs' in titles
    assert 'no label was read at bay 5 / level 1 where "A21-41-2A" belongs' in titles
    assert {finding.grade for finding in findings if finding.code != "label-missing"} == {"red"}
    assert {finding.grade for finding in findings if finding.code == "label-missing"} == {"amber"}


def test_what_was_read_badly_is_amber(plugin: LoadedPlugin) -> None:
    made = signs(0.9)
    first, second = (3, 0, 0), (4, 0, 0)
    made[first], made[second] = written(made[first], made[second]), written(made[second], made[first])
    (finding,) = audited(plugin, made).findings
    assert (finding.code, finding.grade, finding.probability) == ("label-swapped", "amber", pytest.approx(0.81))


def test_two_labels_at_one_place_are_double(plugin: LoadedPlugin) -> None:
    made = signs()
    again = replace(made[9, 1, 1], id="sign 999", vertices=made[9, 1, 1].vertices + np.array([0.2, 0.0, 0.0]))
    (finding,) = audited(plugin, made, extra=[again]).findings
    assert (finding.code, set(finding.subjects)) == ("label-double", {"sign 999", made[9, 1, 1].id})


def test_a_label_that_hangs_in_two_rows_is_double_in_both(plugin: LoadedPlugin) -> None:
    made = signs()
    other = {
        key: replace(sign, attributes=sign.attributes | {"text": "A22" + str(sign.attributes["text"])[3:]})
        for key, sign in made.items()
    }
    wrong = (4, 1, 2)
    made[wrong] = written(made[wrong], other[wrong])
    pattern = PATTERN.replace("A21", r"A\d{2}")
    (here,) = audited(plugin, made, pattern, others={"B": list(other.values())}).findings
    (across,) = audited(plugin, other, pattern, others={"A": list(made.values())}).findings
    assert [here.title, across.title] == ['"A22-43-2C" hangs in row B, too', '"A22-43-2C" hangs in row A, too']
    assert [here.code, here.grade, here.subjects] == ["label-double", "red", (made[wrong].id,)]


def test_a_pattern_that_names_no_row_says_nothing_of_two_rows(plugin: LoadedPlugin) -> None:
    made = signs()
    inspection = audited(plugin, made, others={"B": list(made.values())})
    assert inspection.findings == ()
    assert "names no row" in inspection.unchecked[0]


@pytest.mark.parametrize(
    ("kept", "says"),
    [
        (lambda bay, level: level != 2 or bay % 3, "missing labels on level 2: 68 % of its places"),
        (lambda bay, level: False, "no text matches the pattern"),
    ],
)
def test_what_too_few_labels_tell_is_not_checked(
    plugin: LoadedPlugin, kept: Callable[[int, int], bool], says: str
) -> None:
    inspection = audited(plugin, {key: sign for key, sign in signs().items() if kept(*key[:2])})
    assert inspection.findings == ()
    assert says in inspection.unchecked[0]


def test_numbers_without_an_order_and_labels_without_a_pattern_are_not_checked(plugin: LoadedPlugin) -> None:
    made, rng = signs(), np.random.default_rng(3)
    shuffled = [list(made.values())[k] for k in rng.permutation(len(made))]
    mixed = {key: written(sign, other) for (key, sign), other in zip(made.items(), shuffled, strict=True)}
    assert "follow no order" in audited(plugin, mixed).unchecked[0]
    assert "no `pattern`" in audited(plugin, made, None).unchecked[0]


@pytest.mark.parametrize(
    ("pattern", "says"), [("(", "regular expression"), (r"\d+", "group `bay`"), ("(?P<bay>.)(?P<x>.)", "no other")]
)
def test_a_pattern_that_cannot_be_used_is_refused(plugin: LoadedPlugin, pattern: str, says: str) -> None:
    with pytest.raises(SiteError, match=says):
        plugin.limits({"pattern": pattern}, "limits")
