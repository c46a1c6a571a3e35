"""Signs from features to the map: tracks, factors, sections, scores."""

import gtsam
import numpy as np
import pytest

from savmap.errors import StructureError
from savmap.graph import Constraints
from savmap.types import Structure, Track, Trajectory
from savmap_signs.bays import with_bays
from savmap_signs.constraints import constrain, nearest_size
from savmap_signs.evaluate import evaluate
from savmap_signs.scene import Plate, corners
from savmap_signs.settings import Settings
from savmap_signs.tracking import PARTNERS, partners, track_signs

from .made_up_aisle import PLATES, TRUTH, drive, seen

FACTS, PATH = drive()


@pytest.fixture(scope="module")
def tracks() -> list[Track]:
    return track_signs(seen(PATH, TRUTH), FACTS, PATH, Settings())


def constrained(tracks: list[Track], config: Settings) -> Constraints:
    return constrain(tracks, FACTS, PATH, "signs", config)


def test_every_sign_is_one_track_a_corner_with_its_text(tracks: list[Track]) -> None:
    assert [track.place["text"] for track in tracks[::4]] == [plate.text for plate in PLATES]
    assert [track.name for track in tracks[:2]] == ["sign 1 / upper left", "sign 1 / upper right"]


def test_corners_start_where_they_are(tracks: list[Track]) -> None:
    initial = constrained(tracks, Settings()).initial
    found = np.array([initial[track.name] for track in tracks]).reshape(-1, 4, 3)
    assert np.linalg.norm(found - np.array(TRUTH), axis=-1).max() < 0.03


def test_signs_seen_twice_are_not_mapped() -> None:
    few = [feature for feature in seen(PATH, TRUTH[:1]) if feature.frame in (4, 6)]
    with pytest.raises(StructureError, match="no sign was seen in three frames"):
        track_signs(few, FACTS, PATH, Settings())


def test_a_sighting_s_partners_are_the_next_ones_and_some_of_the_rest() -> None:
    later = np.arange(10, 400)
    chosen = partners(later)
    assert chosen[:PARTNERS].tolist() == later[:PARTNERS].tolist()
    assert len(np.unique(chosen)) == 2 * PARTNERS
    assert chosen[-1] == later[-1]
    assert partners(later[:5]).tolist() == later[:5].tolist()


def test_a_path_that_is_off_costs_no_sign_close_by() -> None:
    poses = PATH.world_from_rig.copy()
    poses[:, :3, 3] += np.random.default_rng(4).uniform(-0.02, 0.02, (len(poses), 3))
    near = Plate(at=(1.4, 1.9, 0.6), size=(0.4, 0.2), text="A21-04")
    sign = corners(near, "+z")
    off = Trajectory(PATH.frames, poses)
    features = seen(PATH, [sign])
    found = track_signs(features, FACTS, off, Settings())
    assert found[0].frames.tolist() == sorted({feature.frame for feature in features})


def test_each_sign_has_a_factor_of_shape_that_holds_of_the_truth(tracks: list[Track]) -> None:
    for shape in ("rectangle", "flat"):
        graph = constrained(tracks, Settings(shape=shape)).factors
        assert graph is not None
        assert graph.size() == len(PLATES)
        for index, sign in enumerate(TRUTH):
            values = gtsam.Values()
            for key, point in zip(graph.at(index).keys(), sign, strict=True):
                values.insert(key, point)
            assert graph.at(index).error(values) == pytest.approx(0.0, abs=1e-12)


def test_known_sizes_and_planes_become_relations(tracks: list[Track]) -> None:
    assert constrained(tracks, Settings()).relations == ()
    known = constrained(tracks, Settings(sizes_m=((0.3, 0.15),), parallel=("face",))).relations
    assert [one.name for one in known if one.name] == [
        f"{what} of sign {n}" for n in (1, 2) for what in ("width", "height")
    ]
    assert [one.axis for one in known if not one.name] == ["z"] * 6


def test_a_size_far_off_is_not_taken() -> None:
    assert nearest_size(TRUTH[0], ((0.8, 0.4), (0.31, 0.15))) == (0.31, 0.15)
    assert nearest_size(TRUTH[0], ((0.4, 0.15),)) is None


def structure(name: str, vertices: np.ndarray, **attributes: float | int | str) -> Structure:
    count = len(vertices)
    label = name.split()[0]
    return Structure(
        name,
        label,
        vertices,
        np.tile(1e-6 * np.eye(3), (count, 1, 1)),
        ("",) * count,
        np.zeros((0, 2), int),
        attributes,
    )


def test_signs_say_which_section_they_hang_at() -> None:
    beams = [
        structure(f"section {n} / beam 1", np.array([[x, 1.0, 0.0], [x + 2.5, 1.0, 0.0]]), section=n)
        for n, x in ((1, 0.1), (2, 2.7))
    ]
    places = {
        "inside": TRUTH[0],
        "at an upright": TRUTH[0] + [1.65, 0, 0],
        "at the last": TRUTH[0] + [4.25, 0, 0],
        "over": TRUTH[2],
    }
    found = with_bays([structure(name, at) for name, at in places.items()], {"shelves": beams})
    assert [own.attributes.get("bay") for own in found] == ["section 1", "section 2", "section 2", None]


def test_scores_count_what_was_read_and_what_was_made_up() -> None:
    survey = {
        "signs": [{"corners": sign.tolist(), "text": plate.text} for sign, plate in zip(TRUTH, PLATES, strict=True)]
    }
    mapped = [
        structure("sign 1", TRUTH[0] + [0.01, 0, 0], text="A21-01"),
        structure("sign 2", TRUTH[1], text="A21-07"),
        structure("sign 3", TRUTH[1] + [9, 0, 0], text=""),
    ]
    score = evaluate(mapped, survey)
    assert score.missing == {"sign text": 2}
    assert score.spurious == {"sign text": 1}
    assert score.apart["signs"].distances_m == pytest.approx([0.01, 0.0])
    assert (score.apart["signs"].missing, score.apart["signs"].spurious) == (1, 1)
    assert evaluate(mapped, {}).apart == {}
