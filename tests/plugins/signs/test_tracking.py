"""Signs tracked through a pass."""

import numpy as np
import pytest

from savmap.errors import StructureError
from savmap.types import Track, Trajectory
from savmap_signs.lab.scene import Plate, corners
from savmap_signs.settings import Settings
from savmap_signs.tracking import PARTNERS, partners, track_signs

from .aisle_pass import PLATES, TRUTH, drive, sign_features

FACTS, PATH = drive()


def test_each_corner_of_a_sign_has_a_track_with_its_text(tracks: list[Track]) -> None:
    assert [track.place["text"] for track in tracks[::4]] == [plate.text for plate in PLATES]
    assert [track.name for track in tracks[:2]] == ["sign 1 / upper left", "sign 1 / upper right"]


def test_a_sign_in_two_frames_is_not_tracked() -> None:
    few = [feature for feature in sign_features(PATH, TRUTH[:1]) if feature.frame in (4, 6)]
    with pytest.raises(StructureError, match="no sign was seen in three frames"):
        track_signs(few, FACTS, PATH, Settings())


def test_partners_are_the_next_sightings_and_a_spread_of_the_rest() -> None:
    later = np.arange(10, 400)
    chosen = partners(later)
    assert chosen[:PARTNERS].tolist() == later[:PARTNERS].tolist()
    assert len(np.unique(chosen)) == 2 * PARTNERS
    assert chosen[-1] == later[-1]
    assert partners(later[:5]).tolist() == later[:5].tolist()


def test_a_path_that_is_off_loses_no_sighting_close_by() -> None:
    poses = PATH.world_from_rig.copy()
    poses[:, :3, 3] += np.random.default_rng(4).uniform(-0.02, 0.02, (len(poses), 3))
    near = Plate(at=(1.4, 1.9, 0.6), size=(0.4, 0.2), text="A21-04")
    features = sign_features(PATH, [corners(near, "+z")])
    tracks = track_signs(features, FACTS, Trajectory(PATH.frames, poses), Settings())
    assert tracks[0].frames.tolist() == sorted({feature.frame for feature in features})
