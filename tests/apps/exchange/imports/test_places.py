"""Elements of a survey in their rows' frames, and what becomes of them."""

from dataclasses import replace

import numpy as np
import pytest

from savmap.apps.exchange.imports.records import Frame, SurveyElement, element, options_of
from savmap.apps.exchange.imports.survey import RowPlaces, in_rows, place_of, survey_of
from savmap.errors import OutputError, SiteError
from savmap.maps.exports.frames import world_from_row
from savmap.types import (
    Alignment,
    Floats,
    FrameTable,
    Placement,
    RowMap,
    SiteMap,
    Structure,
    SurveyEntry,
    Trajectory,
)

POINTS = np.array([[0.0, 0.2, 0.0], [1.0, 2.0, 0.5]])


def row(name: str) -> RowMap:
    path = Trajectory(np.zeros(0, int), np.zeros((0, 4, 4)))
    own = (element("bar 1", "bar", np.array([[0.0, 0, 0], [9, 3, 0]])),)
    return RowMap(name, FrameTable(np.zeros(0), ()), {}, path, {"things": own}, ())


@pytest.fixture
def site() -> SiteMap:
    places = {"A": Placement(2.0, -3.0, 30.0, np.eye(3)), "B": Placement(2.0, -10.0, 30.0, np.eye(3))}
    alignment = Alignment(4321.5, -8765.25, -75.0, np.eye(3), 12.5)
    return SiteMap({name: row(name) for name in places}, {}, placements=places, alignment=alignment)


def moved(points: Floats, transform: Floats) -> Floats:
    result: Floats = points @ transform[:3, :3].T + transform[:3, 3]
    return result


def found(points: Floats, frame: Frame, name: str = "") -> SurveyElement:
    return SurveyElement(name, frame, element("bar 7", "bar", points))


def test_positions_come_back_from_the_world_and_the_site(site: SiteMap) -> None:
    given = [
        found(moved(POINTS, world_from_row(site, "B")), "world", "B"),
        found(moved(POINTS, site.placements["A"].site_from_row), "site", "A"),
        found(POINTS, "row", "A"),
        found(moved(POINTS, world_from_row(site, "B")), "world"),
    ]
    there, notes = in_rows(given, RowPlaces(site), None)
    assert [one.row for one in there] == ["B", "A", "A", "B"]
    assert notes == []
    for one in there:
        assert one.structure.vertices == pytest.approx(POINTS, abs=1e-8)


def test_what_is_far_from_every_row_is_left_out(site: SiteMap) -> None:
    far = found(moved(POINTS + np.array([50.0, 0, 0]), world_from_row(site, "A")), "world")
    assert in_rows([far], RowPlaces(site), None) == ([], ["further than 2 m from every row, left out: 1 (bar 7)"])


def test_of_a_map_of_a_single_row_what_is_across_the_aisle_is_left_out_unless_all_is(site: SiteMap) -> None:
    alone = RowPlaces(replace(site, rows={"A": site.rows["A"]}, placements={"A": site.placements["A"]}))
    world = world_from_row(site, "A")
    shifts = np.array([[0, 0, 0], [50, 0, 1.5], [0, 0, -3.2]])
    near, beyond, behind = (found(moved(POINTS + shift, world), "world") for shift in shifts)
    kept, notes = in_rows([near, beyond, behind], alone, None)
    assert [len(kept), *notes] == [2, "further than 2 m from every row, left out: 1 (bar 7)"]
    assert len(in_rows([near, behind], alone, "A")[0]) == 2
    assert len(in_rows([behind, behind], alone, None)[0]) == 2


def test_a_place_says_where_a_row_stands() -> None:
    name, world = place_of("north=1=10,20,90")
    assert name == "north=1"
    assert moved(np.array([[1.0, 0, 0], [0, 1, 0], [0, 0, 1]]), world) == pytest.approx(
        np.array([[10.0, 21, 0], [10, 20, 1], [11, 20, 0]])
    )
    assert place_of("A=1,2,3,4")[1][2, 3] == 4
    (one,), _ = in_rows([found(moved(POINTS, world), "world")], RowPlaces(None, {name: world}), None)
    assert one.structure.vertices == pytest.approx(POINTS)
    for text in ("A", "A=1,2", "=1,2,3", "A=1,2,x", "A=1,2,nan", "A=1,2,3,4,5"):
        with pytest.raises(SiteError, match="should be ROW=X,Y,HEADING"):
            place_of(text)


@pytest.mark.parametrize(
    ("frame", "name", "message"),
    [
        ("world", "A", "row A has no place: say --map MAP, or --place 'A=X,Y,HEADING'"),
        ("site", "A", "row A has no place: say --map MAP$"),
        ("row", "", "nothing says of which row bar 7 is: say it with --row ROW"),
    ],
)
def test_what_is_not_known_is_asked_for(frame: Frame, name: str, message: str) -> None:
    with pytest.raises(OutputError, match=message):
        in_rows([found(POINTS, frame, name)], RowPlaces(), None)


def test_a_row_without_a_place_is_told(site: SiteMap) -> None:
    apart = replace(site, placements={"A": site.placements["A"]})
    with pytest.raises(OutputError, match="does not say where row B stands in the world's frame"):
        in_rows([found(POINTS, "world", "B")], RowPlaces(apart), None)


@pytest.mark.parametrize(
    ("columns", "unit", "frame"), [({"w": "1"}, None, None), ({}, "mile", None), ({}, None, "moon")]
)
def test_a_wrong_option_is_one_line(columns: dict[str, str], unit: str | None, frame: str | None) -> None:
    with pytest.raises(SiteError, match=r"^--(columns|unit|frame) (w|mile|moon): "):
        options_of(columns, {}, unit, None, frame, False)


def entry(plugin: str, own: list[Structure]) -> SurveyEntry:
    return SurveyEntry(
        {plugin: [thing.vertices.tolist() for thing in own]}, {own[0].id: "it is odd"} if len(own) > 1 else {}
    )


def test_each_plugin_makes_its_part_of_the_entries() -> None:
    twice = [SurveyElement("A", "row", element(f"bar {k}", "BAR", POINTS)) for k in (1, 2)]
    others = [
        SurveyElement("A", "row", element("p", "post", POINTS)),
        SurveyElement("B", "row", element("w", "wall", POINTS)),
    ]
    result = survey_of(
        [*twice, *others], {"bars": ("bar",), "posts": ("post",)}, lambda name, own: entry(name, list(own))
    )
    assert result.survey.rows == {"A": {"bars": [POINTS.tolist()] * 2, "posts": [POINTS.tolist()]}}
    assert list(result.lines()) == [
        "row A: 1 bar, 1 post",
        "note: labels that no plugin takes, left out: 1 wall",
        "note: row A: bar 1 is left out: it is odd",
    ]
    odd = survey_of(twice, {"bars": ("bar",)}, lambda _, own: SurveyEntry({}, {part.id: "odd" for part in own}))
    assert odd.notes == ("row A: bar 1, bar 2 are left out: odd",)


def test_nothing_that_a_plugin_takes_is_refused() -> None:
    with pytest.raises(OutputError, match="nothing in it is called post, but wall: say --layer NAME=LABEL"):
        survey_of(
            [SurveyElement("A", "row", element("w", "wall", POINTS))], {"posts": ("post",)}, lambda *_: SurveyEntry({})
        )
    with pytest.raises(OutputError, match=r"more than 1e[+]06 m from the row: wrong unit"):
        survey_of(
            [SurveyElement("A", "row", element("w", "post", 1e7 * POINTS))],
            {"posts": ("post",)},
            lambda *_: SurveyEntry({}),
        )
