"""Shelves as drawings, and as pictures."""

import copy
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from perfect_maps import Row, structures_of, surveyed_row

from savmap.report.picture import write_row_view
from savmap.types import FrameTable, RowMap, Trajectory
from savmap_shelves.report.evaluation import draw, evaluate


@pytest.fixture
def surveyed() -> Row:
    return surveyed_row()


def test_without_a_survey_every_element_is_drawn_once_in_each_picture(surveyed: Row) -> None:
    drawings = draw(structures_of(surveyed), None, {})
    seen = Counter((picture, own.role) for own in drawings for picture in own.pictures)
    assert seen == {("face", "mapped"): 27, ("plan", "mapped"): 5}
    assert [own.caption for own in drawings if own.pictures == ("plan",)] == ["1", "2", "3", "4", "5"]


def test_survey_underneath_and_what_is_off_in_its_own_role(surveyed: Row) -> None:
    mapped = copy.deepcopy(surveyed)
    mapped["sections"][0]["beams"][1] = [1.26, 1.36]
    mapped["sections"][0]["beams"][2] = [2.34, 2.44]
    mapped["sections"][2]["beams"].insert(0, [1.0, 1.1])
    structures = structures_of(mapped)
    drawings = draw(structures, surveyed, evaluate(structures, surveyed).deviations)
    assert Counter(own.role for own in drawings if "face" in own.pictures) == {"survey": 27, "mapped": 26, "off": 2}
    assert [own.role for own in drawings] == sorted((own.role for own in drawings), key=lambda role: role != "survey")
    off = [own.points[:, 1].min() for own in drawings if own.role == "off"]
    assert off == [1.26, 1.0]


def test_a_picture_of_it(surveyed: Row, tmp_path: Path) -> None:
    structures = structures_of(surveyed)
    trajectory = Trajectory(np.zeros(0, dtype=np.int64), np.zeros((0, 4, 4)))
    row = RowMap("A", FrameTable(np.zeros(0), ()), {}, trajectory, {"shelves": tuple(structures)}, ())
    write_row_view(row, draw(structures, surveyed, {}), "face", tmp_path / "face.png")
    assert (tmp_path / "face.png").stat().st_size > 10_000


def test_corners_in_any_order_make_the_same_outline(surveyed: Row) -> None:
    beam = structures_of(surveyed)[5]
    order = [0, 1, 3, 2]
    crossed = replace(beam, vertices=beam.vertices[order], vertex_labels=tuple(beam.vertex_labels[k] for k in order))
    straight, same = (draw([own], None, {})[0].points for own in (beam, crossed))
    np.testing.assert_array_equal(straight, same)
