"""Which coordinates of a map nothing measured."""

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from savmap import export
from savmap.types import FrameTable, JointCovariance, RowMap, SiteMap, Structure, Trajectory

SOLVED, FREE = [0, 1, 2], [0, -1, 2]
NUMBERS = np.array([SOLVED, FREE, FREE, SOLVED])
HEIGHT_SIGMAS_M = [0.6, 0.6, 0.02, 0.002]


def row() -> RowMap:
    """A post whose first end was measured badly, whose second is assumed, and whose third is worked out of what was measured."""
    covariances = np.array([np.diag([1e-6, sigma**2, 1e-6]) for sigma in HEIGHT_SIGMAS_M])
    post = Structure("post", "post", np.zeros((4, 3)), covariances, tuple("abcd"), np.zeros((0, 2), np.int64))
    joint = JointCovariance({"posts": {"post": NUMBERS}}, np.eye(3))
    path = Trajectory(np.arange(1), np.eye(4)[None])
    return RowMap("A", FrameTable(np.zeros(1), ("pass 1",)), {}, path, {"posts": (post,)}, (), joint=joint)


def test_assumed_is_what_is_unsure_and_not_solved_for() -> None:
    own = row()
    found = own.structures["posts"][0].assumed("posts", own.joint)
    assert np.argwhere(found).tolist() == [[1, 1]]


def test_nothing_is_assumed_where_the_map_does_not_tell() -> None:
    own = replace(row(), joint=None)
    assert not own.structures["posts"][0].assumed("posts", own.joint).any()


def beam(**said: str) -> RowMap:
    """A beam of which no height is unsure by more than 3 cm."""
    labels = ("lower left", "lower right", "upper left", "upper right")
    covariances = np.array([np.diag([1e-6, 1e-4, 1e-6])] * 4)
    own = Structure("beam 1", "beam", np.zeros((4, 3)), covariances, labels, np.zeros((0, 2), np.int64), said)
    return replace(row(), structures={"posts": (own,)}, joint=None)


@pytest.mark.parametrize(
    ("said", "heights"),
    [
        ({"edges": "upper edge not seen"}, [False, False, True, True]),
        ({"edges": "neither edge seen"}, [True] * 4),
        ({"text": "upper edge not seen"}, [False] * 4),
    ],
)
def test_what_its_plugin_says_is_assumed_is_so(said: dict[str, str], heights: list[bool]) -> None:
    own = beam(**said)
    found = own.structures["posts"][0].assumed("posts", own.joint)
    assert found[:, 1].tolist() == heights
    assert not found[:, [0, 2]].any()


def test_tables_say_what_is_assumed(tmp_path: Path) -> None:
    site = SiteMap({"A": row()}, {})
    assert site.to_dataframe()["assumed"].tolist() == ["", "y", "", ""]
    with export(site, tmp_path / "map.csv").open(encoding="utf-8", newline="") as file:
        assert [line["assumed"] for line in csv.DictReader(file)] == ["", "y", "", ""]
