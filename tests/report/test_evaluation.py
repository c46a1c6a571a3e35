"""Scores of plugins pooled over rows, as JSON and as a table."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from savmap.errors import OutputError
from savmap.report.evaluation import as_json, as_table, evaluate_site, mean_absolute_error
from savmap.types import Distances, Evaluation, FrameTable, RowMap, Score, SiteMap, Structure, Survey, Trajectory, pool


def score(errors: list[float], missing: int = 0, spurious: int = 0, far: list[float] | None = None) -> Score:
    return Score(
        errors={"width": np.array(errors), "gap": np.array(errors[:1])},
        coordinates={"edge": np.array(errors)},
        missing={"thing": missing},
        spurious={"thing": spurious},
        distances={} if far is None else {"spots": Distances(np.array(far), missing=1)},
    )


def row(name: str, *plugins: str) -> RowMap:
    trajectory = Trajectory(np.zeros(0, dtype=np.int64), np.zeros((0, 4, 4)))
    return RowMap(name, FrameTable(np.zeros(0), ()), {}, trajectory, dict.fromkeys(plugins, ()), ())


def site(*rows: RowMap) -> SiteMap:
    return SiteMap({own.name: own for own in rows}, {})


def test_json_has_the_published_shape() -> None:
    evaluation = Evaluation({"A": score([0.01, -0.03], far=[0.1, 0.3]), "B": score([0.02], 1, 2)}, ("C",))
    content = as_json(evaluation)
    assert content["mae_m"] == pytest.approx((0.01 + 0.03 + 0.01 + 0.02 + 0.02) / 5)
    assert content["missing"] == {"thing": 1}
    assert content["spurious"] == {"thing": 2}
    assert content["classes"]["width"] == {
        "count": 3,
        "mean_m": 0.0,
        "mae_m": 0.02,
        "p95_m": pytest.approx(0.029),
        "max_m": 0.03,
    }
    assert content["spots"] == {"count": 2, "missing": 1, "spurious": 0, "mae_m": 0.2, "max_m": 0.3}
    assert set(content["rows"]) == {"A", "B"}
    assert content["rows"]["B"]["missing"] == {"thing": 1}
    assert "spots" not in content["rows"]["B"]
    assert (content["not_mapped"], content["not_surveyed"]) == (["C"], [])


def test_nothing_matched_gives_nulls_not_zeros() -> None:
    content = as_json(Evaluation({"A": score([], missing=4)}))
    assert content["mae_m"] is None
    assert content["classes"]["gap"] == {"count": 0, "mean_m": None, "mae_m": None, "p95_m": None, "max_m": None}
    assert mean_absolute_error(pool([])) is None


def test_rows_are_asked_of_the_plugins_that_mapped_them() -> None:
    asked = []

    def ask(row: str, plugin: str, structures: Sequence[Structure], surveyed: Mapping[str, Any]) -> Score:
        asked.append((plugin, surveyed["n"]))
        return score([0.01]) if plugin == "one" else Score()

    survey = Survey({"A": {"n": 1}, "B": {"n": 2}, "C": {"n": 3}})
    evaluation = evaluate_site(site(row("A", "one", "two"), row("B", "one"), row("Z", "one")), survey, ask)
    assert asked == [("one", 1), ("two", 1), ("one", 2)]
    assert set(evaluation.rows) == {"A", "B"}
    assert (evaluation.not_mapped, evaluation.not_surveyed) == (("C",), ("Z",))


def test_where_one_plugin_finds_that_the_map_begins_elsewhere_the_others_are_moved_there() -> None:
    lamp = Structure("lamp 1", "lamp", np.zeros((1, 3)), np.eye(3)[None], ("centre",), np.zeros((0, 2), np.int64))
    begun = replace(row("A"), structures={"racks": (), "lamps": (lamp,)})

    def ask(row: str, plugin: str, structures: Sequence[Structure], surveyed: Mapping[str, Any]) -> Score:
        if plugin == "racks":
            return Score(begins_m=2.7)
        return Score(errors={"place": 2.7 - structures[0].vertices[:, 0]})

    (own,) = evaluate_site(site(begun), Survey({"A": {}}), ask).rows.values()
    assert own.errors["place"].tolist() == [0.0]


def test_deviations_are_those_of_row_and_plugin() -> None:
    off = {("A", "things"): 0.01, ("A", "others"): 0.02, ("B", "things"): 0.03}
    found = evaluate_site(
        site(row("A", "things", "others"), row("B", "things")),
        Survey({"A": {}, "B": {}}),
        lambda name, plugin, *_: Score(deviations={"post 1": off[name, plugin]}),
    )
    assert {key: found.deviations_of(*key)["post 1"] for key in off} == off
    assert found.deviations_of("B", "others") == {}


def test_no_row_in_common_is_an_error() -> None:
    with pytest.raises(OutputError, match=r"map: A; survey: a, b\): name them alike"):
        evaluate_site(site(row("A", "one")), Survey({"b": {}, "a": {}}), lambda *_: Score())


def test_a_malformed_survey_names_the_row() -> None:
    def refuse(*_: object) -> Score:
        raise OutputError("survey: things: Field required")

    with pytest.raises(OutputError, match="row A: survey: things"):
        evaluate_site(site(row("A", "one")), Survey({"A": {}}), refuse)


def test_table_is_aligned_and_says_what_is_missing() -> None:
    evaluation = Evaluation({"A": score([0.01, -0.03], far=[0.1]), "B": score([], 1, 2)}, ("C",))
    text = as_table(evaluation)
    lines = text.splitlines()
    heads = [line for line in lines if line.endswith("largest")]
    widths = [line for line in lines if line.startswith("  width")]
    assert len(heads) == len(widths) == 3
    assert {len(line) for line in heads} == {len(line) for line in widths}
    assert widths[0].split() == ["width", "2", "-1.00", "2.00", "2.90", "3.00"]
    assert widths[1].split() == ["width", "0", "-", "-", "-", "-"]
    assert "  missing: 1 thing; spurious: 2 thing" in lines
    assert "  spots: 1 matched, mean 10.0 cm, largest 10.0 cm; 1 missing, 0 spurious" in lines
    assert lines[-1] == "In the survey, but not mapped: C"
