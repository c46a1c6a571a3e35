"""Tracking on made-up racks: labels, passes, pauses, and plain errors. Random rows: test_tracking_random.py."""

import logging
from dataclasses import replace

import numpy as np
import pytest
import synth
from tracking_truth import counted, shares

from savmap.errors import StructureError
from savmap.types import FrameTable
from savmap_shelves.tracking import track_structures

CLEAN = synth.Faults(
    noise_px=0.2, miss_upright=0, miss_beam=0, duplicate=0, wide=0, false_upright=0, false_beam=0, rear=0, behind=0
)
SHORT = synth.Pass(rate=4, speed=0.9, distance=1.7)


def test_without_faults_nothing_is_lost_or_wrong() -> None:
    rng = np.random.default_rng(5)
    rack = synth.random_rack(rng, 3)
    footage = synth.footage(rack, rng, (SHORT,), CLEAN)
    tracks = track_structures(footage.features, footage.facts, attitudes=footage.attitudes)
    assert counted(tracks) == (4, rack.counts)
    kept, wrong = shares(footage, tracks)
    assert kept > 0.99
    assert wrong == 0


def test_names_places_and_single_observations() -> None:
    rng = np.random.default_rng(7)
    rack = synth.random_rack(rng, 2, bridge=False)
    footage = synth.footage(rack, rng, (SHORT,))
    tracks = {track.name: track for track in track_structures(footage.features, footage.facts)}
    corner = tracks["bay 2 / beam 1 / upper left"]
    assert corner.label == "beam"
    assert corner.place == {"bay": 2, "beam": 1, "side": "left", "edge": "upper"}
    end = tracks["upright 3 / left / bottom"]
    assert end.label == "upright"
    assert end.place == {"upright": 3, "side": "left", "end": "bottom"}
    for track in tracks.values():
        keys = list(zip(track.frames.tolist(), track.views, strict=True))
        assert keys == sorted(set(keys))


def test_covariances_of_upright_ends_keep_their_stretch() -> None:
    rng = np.random.default_rng(7)
    footage = synth.footage(synth.random_rack(rng, 2), rng, (SHORT,))
    tracks = track_structures(footage.features, footage.facts)
    spreads = np.concatenate([np.linalg.eigvalsh(t.covariances) for t in tracks if t.label == "upright"])
    assert (spreads[:, 1] > 100**2).all()
    assert (spreads[:, 0] < 4).all()


@pytest.mark.parametrize("directions", [(1, -1), (1, 1)])
def test_two_passes_are_laid_on_one_another(directions: tuple[int, int]) -> None:
    rng = np.random.default_rng(11)
    rack = synth.random_rack(rng, 3)
    near = replace(SHORT, direction=directions[0])
    far = replace(SHORT, direction=directions[1], distance=2.4, height=3.4)
    footage = synth.footage(rack, rng, (near, far))
    tracks = track_structures(footage.features, footage.facts, attitudes=footage.attitudes)
    assert counted(tracks) == (4, rack.counts)
    assert shares(footage, tracks)[1] < 0.06


def test_a_pause_and_frames_that_show_nothing() -> None:
    rng = np.random.default_rng(12)
    rack = synth.random_rack(rng, 3)
    footage = synth.footage(rack, rng, (replace(SHORT, pause=15),))
    blind = set(range(20, 23)) | {31}
    features = [feature for feature in footage.features if feature.frame not in blind]
    assert counted(track_structures(features, footage.facts)) == (4, rack.counts)


def test_slow_sampling() -> None:
    rng = np.random.default_rng(3)
    rack = synth.random_rack(rng, 5)
    footage = synth.footage(rack, rng, (replace(SHORT, rate=2.5),))
    tracks = track_structures(footage.features, footage.facts, attitudes=footage.attitudes)
    assert counted(tracks) == (6, rack.counts)


def test_beams_beyond_the_last_upright_are_reported(caplog: pytest.LogCaptureFixture) -> None:
    rng = np.random.default_rng(4)
    rack = synth.random_rack(rng, 3, bridge=False)
    footage = synth.footage(rack, rng, (SHORT,), CLEAN)
    last = {(f.frame, f.instance) for f in footage.features if f.label == "upright" and footage.truth[id(f)] == (3,)}
    kept = [f for f in footage.features if not (f.label == "upright" and (f.frame, f.instance) in last)]
    kept = [f for f in kept if "right" not in f.neighbours or (f.frame, f.neighbours["right"]) not in last]
    spoilt = [f for f in footage.features if (f.frame, f.neighbours.get("right", -1)) in last and "right" not in f.part]
    kept += [replace(f, neighbours={"left": f.neighbours["left"]}) for f in spoilt if "left" in f.neighbours]
    with caplog.at_level(logging.WARNING):
        tracks = track_structures(kept, footage.facts)
    assert counted(tracks) == (3, rack.counts[:2])
    assert "on the right" in caplog.text


@pytest.mark.parametrize(("missed", "warned"), [((), False), ((2,), True)])
def test_a_section_far_too_wide_is_reported(
    missed: tuple[int, ...], warned: bool, caplog: pytest.LogCaptureFixture
) -> None:
    rng = np.random.default_rng(21)
    rack = synth.random_rack(rng, 4, bridge=False)
    even = np.array([[2.7 * number, 2.7 * number + 0.1] for number in range(5) if number not in missed])
    levels = [np.array([[0.3, 0.42], [1.6, 1.72], [2.9, 3.02]])] * (len(even) - 1)
    footage = synth.footage(replace(rack, uprights=even, beams=levels), rng, (SHORT,), CLEAN)
    with caplog.at_level(logging.WARNING):
        track_structures(footage.features, footage.facts, attitudes=footage.attitudes)
    assert ("bay 2 is 2.0 times as wide as the others" in caplog.text) is warned


def test_nothing_seen_is_a_plain_error() -> None:
    footage = synth.footage(synth.random_rack(np.random.default_rng(1), 2), np.random.default_rng(1), (SHORT,))
    with pytest.raises(StructureError, match="no upright"):
        track_structures([], footage.facts)
    posts = [feature for feature in footage.features if feature.label == "upright"]
    with pytest.raises(StructureError, match="no beam"):
        track_structures(posts, footage.facts)


def test_too_few_frames() -> None:
    footage = synth.footage(synth.random_rack(np.random.default_rng(1), 2), np.random.default_rng(1), (SHORT,), CLEAN)
    two = [feature for feature in footage.features if feature.frame in (20, 21)]
    with pytest.raises(StructureError, match="2 frames only"):
        track_structures(two, footage.facts)


def test_too_little_motion_says_what_was_found() -> None:
    footage = synth.footage(synth.random_rack(np.random.default_rng(1), 2), np.random.default_rng(1), (SHORT,), CLEAN)
    still = [
        replace(feature, frame=frame) for feature in footage.features if feature.frame == 20 for frame in range(12)
    ]
    facts = replace(footage.facts, frames=FrameTable(np.arange(12) / 4.0, ("pass 1",) * 12))
    with pytest.raises(StructureError, match=r"too little motion.*uprights and .* beams"):
        track_structures(still, facts)


def test_one_upright_is_a_row_seen_in_part() -> None:
    footage = synth.footage(synth.random_rack(np.random.default_rng(2), 3), np.random.default_rng(2), (SHORT,), CLEAN)
    first = {(f.frame, f.instance) for f in footage.features if footage.truth[id(f)] == (0,)}
    kept = [f for f in footage.features if f.label != "upright" or (f.frame, f.instance) in first]
    with pytest.raises(StructureError, match="two uprights"):
        track_structures(kept, footage.facts)
