"""The benches run: from made-up masks to a scored map, seeds in three sets, stored figures, and the pages made of them."""

import argparse
import re
from pathlib import Path

import numpy as np
import pytest

from savmap.maps.map_file import write_map
from savmap.types import FrameTable, RowMap, SiteMap, Trajectory

ROOT = Path(__file__).parents[2]


def test_a_made_up_row_is_mapped_with_true_sigmas() -> None:
    from bench.observed_rows import LOWEST_SIGMA_M, driven_row, given, mapped, row_map
    from bench.sigmas import by_kind, figures_of
    from savmap.lab.sim.observations import MaskErrors
    from savmap_shelves.constraints import GridSettings

    driven = driven_row(5, MaskErrors(0.7), sections=4, levels=(4, 5), frames_a_section=8)
    known = given(driven, np.random.default_rng(5))
    row = mapped(driven, known, GridSettings(known.lowest_m, LOWEST_SIGMA_M))
    assert not any(row.score.missing.values())
    assert not any(row.score.spurious.values())
    table = by_kind([*figures_of(row_map("A", driven, row.solution, row.structures), driven.survey)])
    assert [*table] == ["upright x", "upright width", "beam y", "beam height"]
    assert all(0.3 < figures["error / sigma"] < 3.0 for figures in table.values())


@pytest.mark.slow
def test_changes_of_a_made_up_row_are_told(tmp_path: Path) -> None:
    from bench import compare

    found = [
        one
        for case in ("nothing", "beams")
        for one in compare.outcomes(compare.pair(case, 1, "fine", 5, tmp_path), compare.LEVEL)
    ]
    assert {one.kind for one in found if one.reported in compare.CHANGED} >= {"beam 10 mm", "beam 50 mm"}
    assert sum(one.reported in compare.CHANGED and not one.kind for one in found) <= 2
    assert compare.found_changes(found)["all changes"]["found"] > 50


@pytest.mark.slow
def test_a_site_is_mapped_and_assembled_from_made_up_masks() -> None:
    from bench import site46

    results = [site46.map_task(site46.Task(number, 3, 8)) for number in range(2)]
    assembly, seconds = site46.site_of(results)
    figures = site46.figures_of(results, assembly, seconds)
    assert figures["total"]["missing"] == figures["total"]["spurious"] == 0
    assert figures["assembled"]["across an aisle x m"] < 0.1
    assert [tie.id_a for tie in assembly.site_map.matches[:2]] == ["32 frames", "light 1"]


def test_signs_are_counted_by_what_is_legible_found_read_and_made_up() -> None:
    from bench import signs
    from savmap.lab.sim.scene.build import build
    from savmap.types import Structure

    scene = signs.signed_row(6100, 12, 4096)
    truth = build(scene).survey["rows"]["A"]["signs"]

    def mapped(number: int, corners: object, text: str) -> Structure:
        edges = np.array([[0, 1], [1, 2], [2, 3], [3, 0]])
        labels = ("a", "b", "c", "d")
        own = {"text": text}
        return Structure(f"sign {number}", "sign", np.array(corners), np.zeros((4, 3, 3)), labels, edges, own)

    found = [mapped(n, one["corners"], " ".join(one["text"].split())) for n, one in enumerate(truth)]
    figures = signs.judged(scene, found)
    assert 0 < figures["legible"] == figures["found"] == figures["read"] <= figures["signs"] == len(truth)
    assert max(figures["corners_m"]) < 1e-4
    assert figures["inside"] == 1.0
    assert (figures["invented"], figures["spurious"], figures["not_read"]) == ([], 0, [])
    far = mapped(99, np.array(truth[0]["corners"]) + 2.0, "Z99-99")
    wrong = [mapped(n, np.array(one["corners"]) + 0.01, "A00-00") for n, one in enumerate(truth)]
    figures = signs.judged(scene, [*wrong, far])
    assert (figures["read"], len(figures["invented"]), figures["spurious"]) == (0, len(truth) + 1, 1)
    assert figures["inside"] == 0.0
    assert figures["corners_m"] == pytest.approx([0.0173] * 4 * figures["legible"], abs=1e-3)
    assert signs.line(6100, figures).split()[:2] == ["6100", str(len(truth))]


def test_formats_are_timed_and_faults_counted(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    from bench import exports

    row = RowMap("A", FrameTable(np.zeros(0), ()), {}, Trajectory(np.zeros(0, int), np.zeros((0, 4, 4))), {}, ())
    write_map(SiteMap({"A": row}, {}), tmp_path / "map.json")
    parser = argparse.ArgumentParser()
    exports.add_arguments(parser)
    parser.set_defaults(keep=tmp_path)
    given = [str(tmp_path / "map.json"), "--rows", "2", "--format", "glb", "usda"]
    figures = exports.run(parser.parse_args([*given, "--skip-validators"]))
    assert [cells["faults"] for cells in figures.values()] == [0, 0]
    assert (tmp_path / "map-usda.usda").is_file()
    monkeypatch.setattr(exports, "VALIDATORS", {"glb": {"mine": lambda path: [f"{path.name} is odd"]}})
    assert exports.run(parser.parse_args(given))["glb"]["faults"] == 1
    assert "mine: 1 faults" in capsys.readouterr().out
    assert set(exports.VALIDATORS) <= set(exports.exporters())


def test_lamps_count_as_a_rows_elements() -> None:
    from bench.rows import is_whole

    whole = {"missing": {"beam": 0}, "spurious": {"beam": 0}}
    lamps = {"missing": 0, "spurious": 0}
    assert is_whole(whole)
    assert is_whole({**whole, "lights": lamps})
    assert not is_whole({**whole, "lights": {**lamps, "missing": 1}})
    assert not is_whole({**whole, "lights": {**lamps, "spurious": 1}})


def test_rows_of_the_test_set_are_in_no_other_set() -> None:
    from bench.seeds import SEEDS, SETS, is_test

    for family, sets in SEEDS.items():
        assert tuple(sets) == SETS
        used = {seed for others in SEEDS.values() for name in ("train", "dev") for seed in others[name]}
        assert not used & set(sets["test"])
        assert all(is_test(family, seed) for seed in sets["test"])


def test_rows_of_the_test_set_are_shown_as_totals_only(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    from bench import rows

    figures = {"mae_m": 0.002, "missing": {"beam": 1}, "spurious": {"beam": 0}, "verdict": "check", "seconds": 1.0}
    monkeypatch.setattr(rows, "footage", lambda *_: Path("site.yaml"))
    monkeypatch.setattr(rows, "only_one_row", lambda *_: Path("site.yaml"))
    monkeypatch.setattr(rows, "score", lambda *_: figures)
    parser = argparse.ArgumentParser()
    rows.add_arguments(parser)
    parser.set_defaults(keep=tmp_path)
    total = rows.run(parser.parse_args(["--set", "test"]))["total"]
    assert (total["rows"], total["whole"], total["missing"], total["mean cm"]) == (20, 0, 20, pytest.approx(0.2))
    assert len(capsys.readouterr().out.splitlines()) == 1
    rows.run(parser.parse_args(["--count", "3"]))
    assert len(capsys.readouterr().out.splitlines()) == 4


def test_totals_say_what_is_whole_and_whether_the_probabilities_are_right() -> None:
    from bench.rows import totals

    none = {"upright": 0, "beam": 0}
    face = {"mae_m": 0.002, "missing": none, "spurious": none, "verdict": "trusted", "seconds": 1.0}
    sure, doubtful = [(0.999, True)] * 3, [(0.05, False), (0.2, True), (0.4, False)]
    results = [
        {**face, "objects": sure},
        {**face, "mae_m": 0.02, "objects": doubtful},
        {**face, "missing": {**none, "beam": 2}, "verdict": "check"},
        {**face, "lights": {"missing": 1, "spurious": 0, "mae_m": None}, "verdict": "check"},
        {"error": "no bay shows", "seconds": 1.0},
    ]
    table = totals(results)
    counts = ("rows", "whole", "racks whole", "lamps whole", "good", "good trusted", "trusted", "refused", "missing")
    assert [table["total"][name] for name in counts] == [5, 2, 3, 3, 1, 1, 2, 1, 3]
    assert table["P 0.99 to 1"] == {"objects": 3, "mean P": pytest.approx(0.999), "exist": 1}
    assert table["P 0.1 to 0.5"] == {"objects": 2, "mean P": pytest.approx(0.3), "exist": 0.5}


def test_a_term_of_the_model_is_switched_off_by_its_parameters() -> None:
    from bench.rows import TERMS, without
    from savmap_shelves import find

    before = find.fitted()
    for term in TERMS:
        with without(term):
            changed = find.fitted()
            assert changed != before or find.beam_depth({"bay 1 / beam 1 / lower": np.full(3, 0.1)}) == 0
    assert find.fitted() == before


def test_what_has_become_worse_is_named(tmp_path: Path) -> None:
    from bench import baseline

    better: baseline.Better = {"missing": "less", "found": "more", "cm": "less"}
    before = {"a": {"missing": 1, "found": 0.9, "cm": 1.0, "seconds": 5.0}, "b": {"cm": 0.5}}
    same = {"a": {"missing": 1, "found": 0.89, "cm": 1.01, "seconds": 50.0}, "b": {"cm": 0.1}}
    assert not list(baseline.worse(same, before, better))
    lines = list(baseline.worse({"a": {"missing": 2, "found": 0.7, "cm": 1.1, "seconds": 5.0}}, before, better))
    assert [line.split(":")[0] for line in lines] == ["a, missing", "a, found", "a, cm", "b, cm"]
    file = tmp_path / "baseline.json"
    file.write_text("{}")
    baseline.store("rows", baseline.result_of(before, "--count 3"), file)
    assert baseline.read(file)["rows"].figures == before


def test_pages_are_what_the_stored_results_give() -> None:
    from bench import accuracy_doc, baseline, index

    assert index.README.read_text(encoding="utf-8") == index.readme()
    assert accuracy_doc.PAGE.read_text(encoding="utf-8") == accuracy_doc.page(baseline.read())
    modules = {path.stem for path in index.README.parent.glob("*.py")}
    assert {name.replace("-", "_") for name in index.BENCHES} <= modules
    pages = [path.read_text(encoding="utf-8") for path in (ROOT / "docs").rglob("*.md")]
    named = {name for page in pages for name in re.findall(r"python -m bench ([a-z0-9-]+)", page)}
    assert named <= {*index.BENCHES, "write-docs"}
