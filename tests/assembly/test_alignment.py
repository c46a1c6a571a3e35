"""Where the site stands in the user's world: what points and lines tell, how surely, and what contradicts is named."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from savmap.assembly import aligned, alignment_lines
from savmap.assembly.alignment import Aligned
from savmap.errors import SiteError
from savmap.maps.exports.frames import elements
from savmap.maps.map_file import map_of, map_text
from savmap.site.load import load_alignment
from savmap.types import FrameTable, Placement, RowMap, SiteMap, Structure, Trajectory

HEADING, SHIFT, HEIGHT = np.radians(200.0), np.array([512_345.25, 5_401_234.5]), 3.25
PLACES = np.array([[0.0, 0.0, 0.0], [14.0, 0, 0], [7.0, 2.0, 0.01], [3.5, 1.0, 0.0]])
NAMES = tuple(f"post {k} / top" for k in range(4))


def row(name: str, sigma_m: float = 0.003) -> RowMap:
    posts = tuple(
        Structure(f"post {k}", "post", place[None], sigma_m**2 * np.eye(3)[None], (label,), np.zeros((0, 2), np.int64))
        for k, (place, label) in enumerate(zip(PLACES, NAMES, strict=True))
    )
    path = Trajectory(np.zeros(0, np.int64), np.zeros((0, 4, 4)))
    return RowMap(name, FrameTable(np.zeros(0), ()), {}, path, {"posts": posts}, ())


def two_rows() -> SiteMap:
    places = {"A": Placement(0, 0, 0, np.zeros((3, 3))), "B": Placement(20.0, 5.0, 180.0, np.diag([1e-4, 1e-4, 1e-4]))}
    return SiteMap({"A": row("A"), "B": row("B")}, {}, placements=places)


def known(number: int, row: str = "A", off: tuple[float, ...] = (0.0, 0.0), scale: float = 1.0) -> dict[str, object]:
    """A point as the user knows it: its place in the world where the site stands at SHIFT, turned by HEADING."""
    site = PLACES[number] if row == "A" else two_rows().placements["B"].points(PLACES[number][None])[0]
    turn = np.array([[np.cos(HEADING), -np.sin(HEADING)], [np.sin(HEADING), np.cos(HEADING)]])
    world = scale * turn @ [site[0], -site[2]] + SHIFT
    both = [*world, site[1] + HEIGHT] if len(off) == 3 else world
    return {"row": row, "at": NAMES[number], "world_m": [float(v + o) for v, o in zip(both, off, strict=True)]}


def solved(folder: Path, site: SiteMap, **section: object) -> Aligned:
    (folder / "align.yaml").write_text(yaml.safe_dump({"align": section}), encoding="utf-8")
    return aligned(site, load_alignment(folder / "align.yaml"))


def test_two_points_place_and_turn_the_site(tmp_path: Path) -> None:
    result = solved(tmp_path, two_rows(), points=[known(0), known(1, "B", (0, 0, 0))])
    alignment = result.site_map.alignment
    assert alignment is not None
    assert (alignment.x_m, alignment.y_m) == pytest.approx(tuple(SHIFT), abs=1e-6)
    assert alignment.heading_deg == pytest.approx(-160.0, abs=1e-6)
    assert alignment.z_m == pytest.approx(HEIGHT)
    assert result.notes == ()
    world = {(part.row, part.structure.id): part.structure.vertices[0] for part in elements(result.site_map)}
    np.testing.assert_allclose(world["B", "post 1"][:2], known(1, "B")["world_m"], atol=1e-5)
    assert alignment.scale is not None
    assert alignment.scale.value == pytest.approx(1.0, abs=1e-6)


def test_eastings_may_begin_with_the_number_of_their_zone(tmp_path: Path) -> None:
    zone = (32e6, 0.0)
    result = solved(tmp_path, two_rows(), points=[known(0, off=zone), known(1, "B", zone), known(2, off=zone)])
    read = map_of(map_text(result.site_map), "map").alignment
    assert read is not None
    assert (read.x_m, read.y_m) == pytest.approx((SHIFT[0] + 32e6, SHIFT[1]), abs=1e-5)
    assert read.heading_deg == pytest.approx(-160.0, abs=1e-6)
    assert result.notes == ()


def test_sigmas_are_those_of_repeated_tries(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    site = SiteMap({"A": row("A")}, {})
    tries = []
    for _ in range(150):
        noise = np.hypot(0.01, 0.003) * rng.standard_normal((3, 2))
        points = [known(k, off=tuple(noise[k])) for k in range(3)]
        result = solved(tmp_path, site, points=points).site_map.alignment
        assert result is not None
        tries.append([result.x_m - SHIFT[0], result.y_m - SHIFT[1], result.heading_deg + 160.0])
    spread = np.array(tries).std(axis=0)
    np.testing.assert_allclose(np.sqrt(np.diag(result.covariance)), spread, rtol=0.2)


def test_a_wrong_point_is_named_and_left_out(tmp_path: Path) -> None:
    points = [known(0), known(1), known(2, off=(0.3, -0.4)), known(3)]
    result = solved(tmp_path, SiteMap({"A": row("A")}, {}), points=points)
    (note,) = result.notes
    assert "align.yaml:" in note
    assert "`align.points[2]`: row A, post 2 / top is 0.500 m" in note
    alignment = result.site_map.alignment
    assert alignment is not None
    assert alignment.heading_deg == pytest.approx(-160.0, abs=1e-6)
    assert [residual.used for residual in alignment.residuals] == [True, True, False, True]
    np.testing.assert_allclose(alignment.residuals[2].residual_m, [0.3, -0.4, np.nan], atol=1e-6)
    assert alignment.residuals[2].deviation > 20
    assert sum("left out" in line for line in alignment_lines(result.site_map)) == 1


def test_two_wrong_ones_of_many_are_named(tmp_path: Path) -> None:
    site = two_rows()
    points = [known(k, name) for name in "AB" for k in range(4)]
    points[1], points[6] = known(1, off=(0.5, 0.0)), known(2, "B", (0.0, -0.7))
    notes = solved(tmp_path, site, points=points).notes
    assert sorted(note.split("`")[1] for note in notes) == ["align.points[1]", "align.points[6]"]


def test_two_points_that_contradict_the_map_are_an_error(tmp_path: Path) -> None:
    with pytest.raises(
        SiteError, match=r"align.yaml:\d+: `align`: the two points contradict the map: they are 14.200 m apart"
    ):
        solved(
            tmp_path,
            SiteMap({"A": row("A")}, {}),
            points=[known(0), known(1, off=(-0.2 * np.cos(np.radians(20)), -0.2 * np.sin(np.radians(20))))],
        )


def test_places_that_cannot_be_told_apart_are_an_error(tmp_path: Path) -> None:
    points = [known(0), known(1), known(3, off=(-0.2 * np.sin(HEADING), 0.2 * np.cos(HEADING)))]
    with pytest.raises(SiteError, match="contradict one another, and it cannot be told which is wrong"):
        solved(tmp_path, SiteMap({"A": row("A")}, {}), points=points)


def test_the_scale_is_told_and_stays(tmp_path: Path) -> None:
    site = two_rows()
    points = [known(k, name, scale=1.02) for name in "AB" for k in range(3)]
    result = solved(tmp_path, site, points=points)
    assert "2.00 %" in result.notes[0]
    assert "longer than in the map, whose scale stays" in result.notes[0]
    alignment = result.site_map.alignment
    assert alignment is not None
    assert alignment.scale is not None
    assert alignment.scale.value == pytest.approx(1.02, abs=1e-4)
    assert all(residual.used for residual in alignment.residuals)
    assert result.site_map.rows is site.rows
    assert np.sqrt(alignment.covariance[0, 0]) > 0.02


def test_points_too_near_do_not_tell_the_heading(tmp_path: Path) -> None:
    near = {"at": NAMES[0], "world_m": [1.0, 2.0], "sigma_m": 2.0}
    other = {"at": NAMES[3], "world_m": [2.0, 3.0], "sigma_m": 2.0}
    with pytest.raises(SiteError, match="do not say how the site is turned"):
        solved(tmp_path, SiteMap({"A": row("A")}, {}), points=[near, other])


def line(through: list[str], *numbers: int, row: str = "A") -> dict[str, object]:
    ends = [known(number, row)["world_m"] for number in numbers]
    return {"row": row, "through": through, "world_m": ends}


def test_a_line_and_a_point_tell_it_too(tmp_path: Path) -> None:
    site = SiteMap({"A": row("A")}, {})
    result = solved(tmp_path, site, lines=[line([NAMES[0], NAMES[1]], 0, 1)], points=[known(3)])
    alignment = result.site_map.alignment
    assert alignment is not None
    assert alignment.heading_deg == pytest.approx(-160.0, abs=1e-6)
    assert (alignment.x_m, alignment.y_m) == pytest.approx(tuple(SHIFT), abs=1e-6)


def test_the_order_of_places_directs_a_line(tmp_path: Path) -> None:
    site = SiteMap({"A": row("A")}, {})
    result = solved(tmp_path, site, lines=[line([NAMES[1], NAMES[0]], 0, 1)], points=[known(3)])
    alignment = result.site_map.alignment
    assert alignment is not None
    assert alignment.heading_deg == pytest.approx(20.0, abs=0.2)


def test_lines_alone_leave_the_place_open(tmp_path: Path) -> None:
    with pytest.raises(SiteError, match="do not say where the site stands"):
        solved(tmp_path, SiteMap({"A": row("A")}, {}), lines=[line([NAMES[0], NAMES[1]], 0, 1)])


def test_what_a_rows_place_is_unsure_of_its_points_share(tmp_path: Path) -> None:
    vague = {"A": Placement(0, 0, 0, np.diag([0.3**2, 0.3**2, 0.01**2]))}
    site = SiteMap({"A": row("A")}, {}, placements=vague)
    points = [known(0), known(1), known(2, off=(0.1, 0.05)), known(3)]
    result = solved(tmp_path, site, points=points)
    assert "post 2 / top is 0.112 m" in result.notes[0]
    assert result.site_map.alignment is not None
    assert np.sqrt(result.site_map.alignment.covariance[0, 0]) == pytest.approx(0.3, rel=0.01)


def test_a_pose_is_taken_as_given(tmp_path: Path) -> None:
    anchor = {"latitude_deg": 48.1, "longitude_deg": 11.5}
    section = {"x_m": 1.0, "y_m": 2.0, "heading_deg": 270.0, "z_m": 0.5, "sigma_m": 0.1, "anchor": anchor}
    alignment = solved(tmp_path, two_rows(), **section).site_map.alignment
    assert alignment is not None
    assert (alignment.x_m, alignment.y_m, alignment.z_m, alignment.heading_deg) == (1.0, 2.0, 0.5, -90.0)
    assert alignment.anchor == (48.1, 11.5)
    np.testing.assert_allclose(np.sqrt(np.diag(alignment.covariance)), [0.1, 0.1, 0.5])


@pytest.mark.parametrize(
    ("section", "words"),
    [
        (
            {"points": [known(0), {**known(1), "at": "post 9 / top"}]},
            r"`align.points\[1\]`: row A has no `post 9 / top`; nearest: post",
        ),
        (
            {"points": [known(0), {**known(1), "row": "C"}]},
            r"`align.points\[1\]`: there is no row `C`; the map's rows are A, B",
        ),
        ({"points": [known(0), {"at": "x", "world_m": [0, 1]}]}, r"`align.points\[1\]`: say which `row` it is in"),
        ({"points": [known(0)]}, "one point does not say how the site is turned"),
        ({}, "give two or more points"),
        ({"x_m": 1.0, "y_m": 1.0}, "go together"),
        ({"x_m": 1.0, "points": [known(0), known(1)]}, "not both"),
        ({"points": [known(0), {**known(1), "sigma": 1}]}, "did you mean `sigma_m`"),
        ({"points": [known(0), {**known(1), "world_m": [1.0]}]}, r"align.points\[1\].world_m"),
        ({"lines": [{"row": "A", "through": [NAMES[0]], "world_m": [[1, 1], [1, 1]]}]}, "are the same"),
    ],
)
def test_mistakes_are_one_line_with_their_place(tmp_path: Path, section: dict[str, object], words: str) -> None:
    with pytest.raises(SiteError, match=words) as caught:
        solved(tmp_path, two_rows(), **section)
    assert "\n" not in str(caught.value)
    assert str(caught.value).startswith(str(tmp_path / "align.yaml"))


def test_a_row_without_a_place_tells_nothing(tmp_path: Path) -> None:
    site = SiteMap({"A": row("A"), "B": row("B")}, {})
    with pytest.raises(SiteError, match="row A has no place in the site's frame"):
        solved(tmp_path, site, points=[known(0), known(1)])


def test_rows_that_failed_are_left_out(tmp_path: Path) -> None:
    site = SiteMap({"A": row("A")}, {}, failed={"B": "no video"})
    result = solved(tmp_path, site, points=[known(0), known(1), known(2, "B")])
    assert "row B was not mapped" in result.notes[0]
    assert result.site_map.alignment is not None


def test_names_that_mean_several_are_an_error(tmp_path: Path) -> None:
    one = row("A")
    doubled = RowMap("A", one.frames, {}, one.trajectory, {"posts": one.structures["posts"] * 2}, ())
    with pytest.raises(SiteError, match="there are 2 structures in row A that `post 0 / top` may mean"):
        solved(tmp_path, SiteMap({"A": doubled}, {}), points=[known(0), known(1)])


NUMBERS = st.one_of(st.floats(-1e7, 1e7), st.integers(-20, 20).map(float))
PAIRS = st.tuples(NUMBERS, NUMBERS).map(list)
POINTS = st.fixed_dictionaries(
    {"row": st.sampled_from("AB"), "at": st.sampled_from(NAMES), "world_m": PAIRS},
    optional={"sigma_m": st.floats(1e-4, 10)},
)
LINES = st.fixed_dictionaries(
    {
        "row": st.sampled_from("AB"),
        "through": st.lists(st.sampled_from(NAMES), min_size=1, max_size=3),
        "world_m": st.tuples(PAIRS, PAIRS).filter(lambda ends: ends[0] != ends[1]).map(list),
    }
)


@pytest.mark.slow
@settings(max_examples=25)
@given(st.lists(POINTS, max_size=5), st.lists(LINES, max_size=2))
def test_any_places_align_the_site_or_are_one_line(tmp_path: Path, points: list[object], lines: list[object]) -> None:
    try:
        alignment = solved(tmp_path, two_rows(), points=points, lines=lines).site_map.alignment
    except SiteError as error:
        text = str(error)
    else:
        assert alignment is not None
        text = map_text(replace(two_rows(), alignment=alignment))
        assert np.isfinite(alignment.covariance).all()
        assert np.linalg.eigvalsh(alignment.covariance).min() > -1e-9
        assert map_of(text, "here").alignment is not None
        text = ""
    assert "\n" not in text
