"""Nothing slips by one bay: runs of frames without uprights, look-alike bays, gross outliers, neighbouring levels swapped."""

from dataclasses import replace

import numpy as np
import pytest
import synth
from tracking_truth import counted, shares

from savmap.types import Feature
from savmap_shelves.tracking import track_structures

pytestmark = pytest.mark.slow

ONE = synth.Pass(rate=4, speed=0.9, distance=1.7)


def alike(sections: int, levels: int = 5) -> synth.Rack:
    """Bays that look all the same."""
    starts = 2.8 * np.arange(sections + 1)
    bottoms = 0.2 + 1.1 * np.arange(levels)
    beams = tuple(np.column_stack([bottoms, bottoms + 0.1]) for _ in range(sections))
    return synth.Rack(np.column_stack([starts, starts + 0.1]), beams, 6.0)


def blinded(footage: synth.Footage, first: int, count: int, label: str) -> list[Feature]:
    """Features without those of a class in a run of frames; beams do not know their uprights then."""
    blind = range(first, first + count)
    kept = [f for f in footage.features if not (f.label == label and f.frame in blind)]
    if label == "upright":
        kept = [f for f in kept if f.frame not in blind or len(f.pixels) == 2]
        blinded_ones = {id(f): replace(f, neighbours={}) for f in kept if f.frame in blind}
        kept = [blinded_ones.get(id(f), f) for f in kept]
    return kept


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("count", [6, 12])
def test_look_alike_bays_and_a_run_of_frames_without_uprights(seed: int, count: int) -> None:
    """At 0.9 m/s and 4 frames a second 12 frames are 2.7 m: a whole bay."""
    rng = np.random.default_rng(50 + seed)
    rack = alike(5)
    footage = synth.footage(rack, rng, (ONE,))
    features = blinded(footage, 25, count, "upright")
    tracks = track_structures(features, footage.facts, attitudes=footage.attitudes)
    assert counted(tracks) == (len(rack.uprights), rack.counts)


@pytest.mark.parametrize("seed", range(2))
def test_gross_outliers_among_all_features(seed: int) -> None:
    rng = np.random.default_rng(60 + seed)
    rack = synth.random_rack(rng, 3, (4, 6))
    footage = synth.footage(rack, rng, (ONE,))
    features, moved = [], dict(footage.truth)
    for feature in footage.features:
        if rng.random() < 0.1:
            away = replace(feature, pixels=feature.pixels + rng.normal(0, 30, 2))
            moved[id(away)] = None if feature.label == "beam" else footage.truth[id(feature)]
            features.append(away)
        else:
            features.append(feature)
    tracks = track_structures(features, footage.facts, attitudes=footage.attitudes)
    assert counted(tracks) == (len(rack.uprights), rack.counts)
    kept = {id(f) for f in features}
    assert all(one in moved for one in kept)


def test_neighbouring_levels_given_for_one_another() -> None:
    """In one frame of ten the corners of a level have the pixels of the next one."""
    rng = np.random.default_rng(70)
    rack = alike(3)
    footage = synth.footage(rack, rng, (ONE,))
    swapped = []
    pixels = {(f.frame, footage.truth[id(f)], f.part): f.pixels for f in footage.features if f.label == "beam"}
    for feature in footage.features:
        own = footage.truth[id(feature)]
        above = pixels.get((feature.frame, (own[0], own[1] + 1), feature.part)) if own and len(own) == 2 else None
        if feature.frame % 10 == 3 and above is not None:
            swapped.append(replace(feature, pixels=above))
        else:
            swapped.append(feature)
    tracks = track_structures(swapped, footage.facts, attitudes=footage.attitudes)
    assert counted(tracks) == (len(rack.uprights), rack.counts)


def test_two_passes_of_look_alike_bays_are_not_laid_one_bay_apart() -> None:
    rng = np.random.default_rng(80)
    rack = alike(4)
    footage = synth.footage(rack, rng, (ONE, replace(ONE, distance=2.2, direction=-1)))
    tracks = track_structures(footage.features, footage.facts, attitudes=footage.attitudes)
    assert counted(tracks) == (len(rack.uprights), rack.counts)
    assert shares(footage, tracks)[1] < 0.06
