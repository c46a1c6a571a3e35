"""The benches at observation level run: a small row from made-up masks to a scored map, and what they print of it."""

import sys
from pathlib import Path

import numpy as np
import pytest

from savmap.maps.map_file import write_map
from savmap.types import FrameTable, RowMap, SiteMap, Trajectory

BENCH = Path(__file__).parents[2] / "bench"


@pytest.fixture(autouse=True)
def _benches(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "path", [str(BENCH), *sys.path])


def test_a_made_up_row_is_mapped_by_both_methods() -> None:
    import observed
    from observed_rows import LOWEST_SIGMA_M, driven_row, given, mapped
    from uncertainty import figures, summary

    from savmap.lab.sim.observations import MaskErrors
    from savmap_shelves.constraints import GridSettings

    driven = driven_row(5, MaskErrors(0.7), sections=4, levels=(4, 5), frames_a_section=8)
    known = given(driven, np.random.default_rng(5))
    row = mapped(driven, known, GridSettings(known.lowest_m, LOWEST_SIGMA_M))
    assert not any(row.score.missing.values())
    assert not any(row.score.spurious.values())
    errors = np.array([error / sigma for _, error, sigma in figures(driven.survey, row.tracks, row.solution)])
    assert len(errors) > 20
    assert 0.3 < summary(errors)["spread"] < 3.0
    assert set(observed.METHODS) == {"ours", "published"}


@pytest.mark.slow
def test_changes_of_a_made_up_row_are_told(tmp_path: Path) -> None:
    import compare
    from compared_rows import pair

    found = [
        one
        for case in ("nothing", "beams")
        for one in compare.outcomes(pair(case, 1, "fine", 5, tmp_path), compare.LEVEL)
    ]
    assert {one.kind for one in found if one.told in compare.CHANGED} >= {"beam 10 mm", "beam 50 mm"}
    assert sum(one.told in compare.CHANGED and not one.kind for one in found) <= 2
    assert any(line.startswith("all ") for line in compare.table(found))


@pytest.mark.slow
def test_what_is_off_about_a_camera_is_found() -> None:
    import calibration

    found = calibration.run_case(calibration.Case(1.0, read_out_s=0.02), 1, 2, 6)
    assert found["both"]["turn_rms_deg"] < 0.2
    assert found["both"]["read_out_rms_ms"] < 16.0
    assert found["both"]["residual_scale"] < found["off"]["residual_scale"]
    assert calibration.line("both", found).startswith("both")


@pytest.mark.slow
def test_a_site_is_mapped_and_assembled_from_made_up_masks(capsys: pytest.CaptureFixture[str]) -> None:
    import site46
    from site_rows import Task

    results = [site46.map_task(Task(number, 3, 8)) for number in range(2)]
    score = site46.pool(result.score for result in results)
    assembly, seconds = site46.site_of(results)
    figures = site46.print_site(results, score, assembly, seconds)
    assert figures["counts"]["missing or spurious"] == 0
    assert figures["places"]["across an aisle x m"] < 0.1
    assert [tie.id_a for tie in assembly.site_map.matches[:2]] == ["32 frames", "light 1"]
    assert "736 vertical and 4920 horizontal" in capsys.readouterr().out


def test_throughput_maps_a_repeated_file_row_by_row_and_tells_each_stage_s_share(tmp_path: Path) -> None:
    import throughput

    from savmap.site.load import load_site

    throughput.write_site(throughput.SITE, tmp_path / "8k-2.mp4", 2, 16.5, tmp_path / "site.yaml")
    rows = load_site(tmp_path / "site.yaml").rows
    assert [(name, row.passes[0].start_s, row.passes[0].end_s) for name, row in rows.items()] == [
        ("A1", 0.0, 16.5),
        ("A2", 16.5, 33.0),
    ]
    way = {"clock_s": 13.0, "processor_s": 20.0, "peak_mb": 900.0}
    lines = throughput.table(
        {
            "length": 2,
            "jobs": 0,
            "rounds": 1,
            "frames": 100,
            "ours": way,
            "bound": {"clock_s": 10.0, "processor_s": 16.0},
            "stages": {"decode": 16.0, "segment": 4.0},
            "ratio": {"clock_s": 1.3, "processor_s": 1.25},
        }
    )
    assert "decode                          16.0   80.0%       160.0" in lines
    assert "ratio 1.30 by the clock, 1.25 by processor time" in lines
    assert lines[-1] == "peak memory 900 MB"


def test_signs_are_counted_by_what_is_legible_found_read_and_made_up() -> None:
    import signs

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


def test_formats_are_timed_and_faults_end_with_1(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    import exports

    row = RowMap("A", FrameTable(np.zeros(0), ()), {}, Trajectory(np.zeros(0, int), np.zeros((0, 4, 4))), {}, ())
    write_map(SiteMap({"A": row}, {}), tmp_path / "map.json")
    arguments = [str(tmp_path / "map.json"), "--rows", "2", "--format", "glb", "usda", "-o", str(tmp_path / "out")]
    assert exports.main([*arguments, "--skip-validators"]) == 0
    assert (tmp_path / "out" / "map-usda.usda").is_file()
    monkeypatch.setattr(exports, "VALIDATORS", {"glb": {"mine": lambda path: [f"{path.name} is odd"]}})
    assert exports.main(arguments) == 1
    assert "mine: 1 faults" in capsys.readouterr().out
    assert set(exports.VALIDATORS) <= set(exports.FORMATS)


def test_lamps_count_as_a_rows_elements() -> None:
    from rows import is_whole

    whole = {"missing": {"beam": 0}, "spurious": {"beam": 0}}
    lamps = {"missing": 0, "spurious": 0}
    assert is_whole(whole)
    assert is_whole({**whole, "lights": lamps})
    assert not is_whole({**whole, "lights": {**lamps, "missing": 1}})
    assert not is_whole({**whole, "lights": {**lamps, "spurious": 1}})
