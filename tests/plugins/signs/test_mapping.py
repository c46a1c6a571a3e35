"""Signs in the factor graph and in the map."""

import gtsam
import numpy as np
import pytest

from savmap.graph import Constraints
from savmap.types import Track
from savmap_signs.mapping import constrain, nearest_size, with_bays
from savmap_signs.settings import Settings

from .aisle_pass import PLATES, TRUTH, drive, structure

FACTS, PATH = drive()


def constrained(tracks: list[Track], config: Settings) -> Constraints:
    return constrain(tracks, FACTS, PATH, "signs", config)


def test_corners_start_near_the_truth(tracks: list[Track]) -> None:
    initial = constrained(tracks, Settings()).initial
    positions = np.array([initial[track.name] for track in tracks]).reshape(-1, 4, 3)
    assert np.linalg.norm(positions - np.array(TRUTH), axis=-1).max() < 0.03


def test_the_factor_of_shape_is_zero_for_the_truth(tracks: list[Track]) -> None:
    for shape in ("rectangle", "flat"):
        graph = constrained(tracks, Settings(shape=shape)).factors
        assert graph is not None
        assert graph.size() == len(PLATES)
        for index, sign in enumerate(TRUTH):
            values = gtsam.Values()
            for key, point in zip(graph.at(index).keys(), sign, strict=True):
                values.insert(key, point)
            assert graph.at(index).error(values) == pytest.approx(0.0, abs=1e-12)


def test_known_sizes_and_planes_give_relations(tracks: list[Track]) -> None:
    assert constrained(tracks, Settings()).relations == ()
    known = constrained(tracks, Settings(sizes_m=((0.3, 0.15),), parallel=("face",))).relations
    assert [relation.name for relation in known if relation.name] == [
        f"{what} of sign {n}" for n in (1, 2) for what in ("width", "height")
    ]
    assert [relation.axis for relation in known if not relation.name] == ["z"] * 6


def test_a_size_far_off_is_not_used() -> None:
    assert nearest_size(TRUTH[0], ((0.8, 0.4), (0.31, 0.15))) == (0.31, 0.15)
    assert nearest_size(TRUTH[0], ((0.4, 0.15),)) is None


def test_signs_at_the_face_get_the_section_they_hang_at() -> None:
    beams = [
        structure(f"bay {n} / beam 1", np.array([[x, 1.0, 0.0], [x + 2.5, 1.0, 0.0]]), bay=n)
        for n, x in ((1, 0.1), (2, 2.7))
    ]
    places = {
        "inside": TRUTH[0],
        "at an upright": TRUTH[0] + [1.65, 0, 0],
        "at the last": TRUTH[0] + [4.25, 0, 0],
        "over": TRUTH[2],
    }
    related = with_bays([structure(name, at) for name, at in places.items()], {"shelves": beams})
    assert [sign.attributes.get("bay") for sign in related] == ["bay 1", "bay 2", "bay 2", None]
