"""Rows in one site frame: what ties them, what is refused, and how well they come out."""

from dataclasses import replace

import numpy as np
import pytest

from savmap.assembly import assembled, site_lines
from savmap.types import MapWarning, Placement, SiteMap, Trajectory

from .made_up_site import (
    AISLE_M,
    LENGTH_M,
    PITCH_M,
    Noise,
    ask,
    off,
    one_drive_an_aisle,
    priors,
    site,
    truth,
)

NO_DRIVES: dict[str, dict[str, str]] = {}
CHI2_999 = 16.3
"""Of three degrees of freedom."""


def chi2(found: Placement, wanted: Placement) -> float:
    left = off(found, wanted)
    return float(left @ np.linalg.solve(found.covariance, left))


def moved(site_map: SiteMap, row: str, thing: str, by: tuple[float, float, float]) -> SiteMap:
    """The map with one thing of a row somewhere else."""
    own = site_map.rows[row]
    found = [
        replace(one, vertices=one.vertices + np.array(by)) if one.id == thing else one
        for one in own.structures["made up"]
    ]
    return replace(site_map, rows={**site_map.rows, row: replace(own, structures={"made up": tuple(found)})})


def warned(site_map: SiteMap, row: str) -> tuple[MapWarning, ...]:
    """What speaks against a row."""
    verdict = site_map.rows[row].verdict
    return verdict.warnings if verdict else ()


def warnings_of(site_map: SiteMap) -> set[tuple[str, str, tuple[str, ...]]]:
    """Rows with the kinds of their warnings and the structures that these name."""
    return {(row, warning.code, warning.subjects) for row in site_map.rows for warning in warned(site_map, row)}


def test_shared_camera_path_places_the_row_across_the_aisle() -> None:
    site_map = site(1, np.random.default_rng(1))
    found = assembled(site_map, {}, one_drive_an_aisle(list(site_map.rows)), ask).site_map
    assert off(found.placements["1L"], Placement(0, 0, 0, np.eye(3))) == pytest.approx([0, 0, 0], abs=1e-6)
    across = found.placements["1R"]
    assert off(across, truth(1)["1R"]) == pytest.approx([0, 0, 0], abs=0.03)
    assert chi2(across, truth(1)["1R"]) < CHI2_999
    assert [(tie.id_a, tie.id_b) for tie in found.matches[:2]] == [("60 frames", "60 frames"), ("lamp 1", "lamp 7")]
    assert np.abs(found.matches[1].residual_m).max() < 0.2


def test_frames_of_one_recording_at_other_times_tie_rows() -> None:
    site_map = site(1, np.random.default_rng(2), noise=Noise(path=0.0))
    own = site_map.rows["1R"]
    keep = np.arange(30)
    path = own.trajectory
    between = path.world_from_rig[keep].copy()
    between[:, :3, 3] += 0.5 * (path.world_from_rig[keep + 1] - path.world_from_rig[keep])[:, :3, 3]
    table = replace(own.frames, stamps_s=(keep + 0.5) / 2, passes=("pass 1",) * 30)
    half = replace(own, frames=table, trajectory=replace(path, frames=keep, world_from_rig=between, sigma_m=None))
    found = assembled(replace(site_map, rows={**site_map.rows, "1R": half}), {}, one_drive_an_aisle(["1L", "1R"]), ask)
    assert off(found.site_map.placements["1R"], truth(1)["1R"]) == pytest.approx([0, 0, 0], abs=2e-3)


def test_a_regular_site_comes_out_square() -> None:
    squares, turns, sides = [], [], []
    for seed in range(3):
        rng = np.random.default_rng(seed)
        site_map = site(6, rng)
        known = priors(truth(6), rng)
        found = assembled(site_map, known, one_drive_an_aisle(list(site_map.rows)), ask)
        assert found.notes == ()
        assert not warnings_of(found.site_map)
        placed = found.site_map.placements
        squares += [chi2(placed[name], place) for name, place in truth(6).items()]
        first = placed["1L"]
        turns += [off(place, truth(6)[name])[2] - off(first, truth(6)["1L"])[2] for name, place in placed.items()]
        sides += [
            off(placed[f"{k}R"], truth(6)[f"{k}R"])[0] - off(placed[f"{k + 1}L"], truth(6)[f"{k + 1}L"])[0]
            for k in range(1, 6)
        ]
        assert off(known["3L"], truth(6)["3L"])[2] != 0
    assert max(squares) < CHI2_999
    assert np.mean(squares) < 4.0
    assert np.abs(turns).max() < 0.2
    assert np.abs(sides).max() < 0.03


def test_rows_without_right_angles_keep_their_headings() -> None:
    rng = np.random.default_rng(3)
    site_map = site(3, rng)
    known = {
        **priors(truth(3), rng, sigma_deg=0.05),
        "3L": Placement(0.0, 2 * PITCH_M, 3.0, np.diag([0.04, 0.04, 0.01])),
    }
    del known["3R"]
    loose = assembled(site_map, known, NO_DRIVES, ask, square_deg=None).site_map.placements["3L"]
    held = assembled(site_map, known, NO_DRIVES, ask, square_deg=0.02).site_map.placements["3L"]
    assert loose.heading_deg == pytest.approx(3.0, abs=0.1)
    assert held.heading_deg < 2.0


def test_lamps_tie_rows_that_were_driven_past_one_by_one() -> None:
    rng = np.random.default_rng(4)
    site_map = site(1, rng)
    known = priors(truth(1), rng, sigma_m=0.4, sigma_deg=0.1)
    known["1L"] = Placement(0.0, 0.0, 0.0, np.diag([1e-6, 1e-6, 1e-6]))
    found = assembled(site_map, known, NO_DRIVES, ask).site_map
    assert len(found.matches) == 7
    assert np.abs(off(found.placements["1R"], truth(1)["1R"])[:2]).max() < 0.06
    assert np.sqrt(found.placements["1R"].covariance[0, 0]) < 0.06
    assert chi2(found.placements["1R"], truth(1)["1R"]) < CHI2_999


@pytest.mark.parametrize("slip", [4.0, -4.0])
def test_a_regular_line_of_lamps_may_not_slip_by_one(slip: float) -> None:
    site_map = site(1, np.random.default_rng(5))
    wrong = Placement(LENGTH_M + slip, AISLE_M, 180.0, np.diag([4.0, 0.01, 0.01]))
    found = assembled(site_map, {"1L": Placement(0, 0, 0, 1e-6 * np.eye(3)), "1R": wrong}, NO_DRIVES, ask)
    assert found.site_map.matches == ()
    assert found.site_map.placements["1R"].x_m == pytest.approx(LENGTH_M + slip, abs=0.01)
    assert found.notes == ("rows 1L and 1R: which lamp is which is ambiguous; none of them is matched",)


def test_an_irregular_line_of_lamps_is_recognised_from_far_off() -> None:
    site_map = site(1, np.random.default_rng(6), spacing=(2.0, 4.0, 3.1, 4.9, 4.0, 2.4, 5.0))
    wrong = Placement(LENGTH_M + 4.0, AISLE_M, 180.0, np.diag([4.0, 0.01, 0.01]))
    found = assembled(site_map, {"1L": Placement(0, 0, 0, 1e-6 * np.eye(3)), "1R": wrong}, NO_DRIVES, ask).site_map
    assert len(found.matches) == 7
    assert found.placements["1R"].x_m == pytest.approx(LENGTH_M, abs=0.06)


def test_a_lamp_that_is_another_one_is_left_out_and_named() -> None:
    rng = np.random.default_rng(7)
    site_map = moved(site(1, rng, noise=Noise(lamp=0.1)), "1R", "lamp 4", (0.0, 0.0, 0.9))
    known = {
        "1L": Placement(0, 0, 0, 1e-6 * np.eye(3)),
        "1R": replace(truth(1)["1R"], covariance=np.diag([0.25, 0.25, 0.01])),
    }
    straight = assembled(site(1, np.random.default_rng(7), noise=Noise(lamp=0.1)), known, NO_DRIVES, ask)
    found = assembled(site_map, known, NO_DRIVES, ask)
    assert ("lamp 4", "lamp 4") not in {(tie.id_a, tie.id_b) for tie in found.site_map.matches}
    assert off(found.site_map.placements["1R"], straight.site_map.placements["1R"]) == pytest.approx(
        [0, 0, 0], abs=0.05
    )


def test_match_that_does_not_fit_is_left_out_and_named() -> None:
    """Where headings are hardly known, lamps at the row's end may be far from where they should be, until the row is placed."""
    rng = np.random.default_rng(7)
    site_map = moved(site(1, rng), "1R", "lamp 7", (0.0, 0.0, 0.6))
    loose = replace(truth(1)["1R"], covariance=np.diag([0.25, 0.25, 4.0]))
    known = {"1L": Placement(0, 0, 0, 1e-6 * np.eye(3)), "1R": loose}
    found = assembled(site_map, known, NO_DRIVES, ask, square_deg=None)
    assert len(found.site_map.matches) == 6
    assert warnings_of(found.site_map) == {
        ("1L", "site-misfit", ("lamp 1", "row 1R")),
        ("1R", "site-misfit", ("lamp 7", "row 1L")),
    }
    (warning,) = warned(found.site_map, "1R")
    assert warning.figure.startswith("0.")
    assert warning.figure.endswith(" sigma")
    assert warning.place is not None
    assert chi2(found.site_map.placements["1R"], truth(1)["1R"]) < CHI2_999


def test_rows_that_put_a_drive_elsewhere_are_warned() -> None:
    """One row has the camera 20 cm higher than the row across the aisle, on the same drive: one height is wrong."""
    site_map = site(1, np.random.default_rng(3))
    own = site_map.rows["1R"]
    poses = own.trajectory.world_from_rig.copy()
    poses[:, 1, 3] -= 0.2
    raised = replace(own, trajectory=replace(own.trajectory, world_from_rig=poses))
    found = assembled(
        replace(site_map, rows={**site_map.rows, "1R": raised}), {}, one_drive_an_aisle(["1L", "1R"]), ask
    )
    for row in ("1L", "1R"):
        (warning,) = warned(found.site_map, row)
        assert warning.code == "site-misfit"
        assert "m apart in height, " in warning.figure


def test_both_faces_of_a_rack_agree_along_it() -> None:
    rng = np.random.default_rng(8)
    site_map = site(2, rng)
    known = priors(truth(2), rng, sigma_m=0.15)
    found = assembled(site_map, known, NO_DRIVES, ask).site_map
    backs = [tie for tie in found.matches if tie.id_a.startswith("upright")]
    assert len(backs) == 13
    assert {(tie.row_a, tie.row_b) for tie in backs} == {("1R", "2L")}
    assert all(np.isnan(tie.residual_m[[1, 2]]).all() for tie in backs)
    apart = off(found.placements["1R"], truth(2)["1R"])[0] - off(found.placements["2L"], truth(2)["2L"])[0]
    assert abs(apart) < 0.02
    assert abs(known["1R"].x_m - LENGTH_M - known["2L"].x_m) > 0.05


def test_a_row_that_nothing_ties_stays_without_a_place() -> None:
    site_map = site(2, np.random.default_rng(9))
    drives = one_drive_an_aisle(["1L", "1R"])
    found = assembled(site_map, {}, drives, ask).site_map
    assert set(found.placements) == {"1L", "1R"}
    said = "\n".join(site_lines(found))
    assert "not placed: 2L, 2R" in said
    assert "give each a `place`, or the site a `layout`" in said
    alone = assembled(site_map, {}, NO_DRIVES, ask).site_map
    assert alone.placements == {}
    assert alone.matches == ()
    assert list(site_lines(alone)) == []


def test_wrong_place_is_named_and_bends_no_other_aisle() -> None:
    rng = np.random.default_rng(10)
    site_map = site(3, rng)
    known = priors(truth(3), rng, sigma_m=0.05, sigma_deg=0.1)
    known["2R"] = replace(known["2R"], x_m=known["2R"].x_m + 2.0)
    found = assembled(site_map, known, one_drive_an_aisle(list(site_map.rows)), ask)
    assert {row for row, _, _ in warnings_of(found.site_map)} == {"2L", "2R"}
    assert warned(found.site_map, "2R")[0].subjects == ("row 2R",)
    placed = found.site_map.placements
    left = {name: off(place, truth(3)[name]) for name, place in placed.items()}
    assert max(np.abs(left[name][:2]).max() for name in ("1L", "1R", "3L", "3R")) < 0.15
    assert left["2R"] - left["2L"] == pytest.approx([0, 0, 0], abs=0.05)


def test_what_is_known_exactly_is_no_trouble() -> None:
    site_map = site(1, np.random.default_rng(12), noise=Noise(0.0, 0.0, 0.0))
    found = assembled(site_map, truth(1), NO_DRIVES, ask)
    assert found.notes == ()
    assert not warnings_of(found.site_map)
    assert len(found.site_map.matches) == 7
    assert off(found.site_map.placements["1R"], truth(1)["1R"]) == pytest.approx([0, 0, 0], abs=1e-6)


def test_empty_rows_keep_their_given_places() -> None:
    site_map = site(1, np.random.default_rng(13))
    empty = {
        name: replace(
            own, structures={"made up": ()}, trajectory=Trajectory(np.zeros(0, np.int64), np.zeros((0, 4, 4)))
        )
        for name, own in site_map.rows.items()
    }
    known = priors(truth(1), np.random.default_rng(13))
    found = assembled(SiteMap(empty, {}), known, one_drive_an_aisle(list(empty)), ask, square_deg=None).site_map
    assert found.matches == ()
    assert found.placements["1R"].x_m == pytest.approx(known["1R"].x_m)
    assert found.placements["1R"].covariance == pytest.approx(known["1R"].covariance, rel=1e-3, abs=1e-9)


def test_a_whole_site_is_assembled() -> None:
    rng = np.random.default_rng(11)
    site_map = site(23, rng)
    known = priors(truth(23), rng)
    drives = one_drive_an_aisle(list(site_map.rows))
    found = assembled(site_map, known, drives, ask).site_map
    assert len(found.placements) == 46
    lines = list(site_lines(found))
    assert len(lines) == 1 + 46 + 1 + 23 + 23 + 22
