"""Edges that goods hide in all frames: what is read there is not tracked, and the beam is."""

from dataclasses import replace

import numpy as np
import pytest
import synth
from savmap_shelves.evidence.hidden_edges import hidden_edges

from savmap.types import Feature, Floats
from savmap_shelves.tracking import track_structures

FRAMES, HEIGHT, LEVELS, ODD = 20, 0.1, 5, 2
WHICH = np.tile(np.arange(LEVELS), FRAMES)
EVERY = np.ones(LEVELS, np.bool_)
GOODS = HEIGHT * np.linspace(0.3, 0.85, FRAMES)
"""How far above its lower edge the odd beam's upper one is read."""


def readings(upper: Floats, lower: Floats | None = None) -> Floats:
    """Heights (100, 2) of the edges of five levels in twenty frames, of which one's are read so far above its lower edge."""
    found = np.column_stack([WHICH, WHICH + HEIGHT]).astype(np.float64)
    found[WHICH == ODD] = ODD + np.column_stack([np.zeros(FRAMES) if lower is None else lower, upper])
    return found


def test_an_edge_of_goods_that_moves_before_a_steady_beam_is_hidden() -> None:
    found = hidden_edges(WHICH, readings(GOODS), EVERY)
    assert found.tolist() == [[False, level == ODD] for level in range(LEVELS)]
    assert not hidden_edges(WHICH, readings(GOODS), EVERY & (np.arange(LEVELS) != ODD)).any()


def test_a_lower_edge_may_be_hidden_too() -> None:
    found = hidden_edges(WHICH, readings(np.full(FRAMES, HEIGHT), HEIGHT - GOODS), EVERY)
    assert found.tolist() == [[level == ODD, False] for level in range(LEVELS)]


@pytest.mark.parametrize(
    ("upper", "lower"),
    [
        (np.full(FRAMES, 0.6 * HEIGHT), np.zeros(FRAMES)),
        (GOODS, -GOODS[::-1] + HEIGHT / 2),
        (HEIGHT * np.linspace(0.9, 1.3, FRAMES), np.zeros(FRAMES)),
    ],
    ids=["a thin beam behind", "nothing steady", "not thin"],
)
def test_no_edge_is_hidden(upper: Floats, lower: Floats) -> None:
    assert not hidden_edges(WHICH, readings(upper, lower), EVERY).any()


def test_no_edge_is_hidden_where_beams_have_no_usual_height() -> None:
    found = readings(GOODS)
    found[:, 1] += 0.05 * WHICH * (WHICH != ODD)
    assert not hidden_edges(WHICH, found, EVERY).any()


CLEAN = synth.Faults(
    noise_px=0.2, miss_upright=0, miss_beam=0, duplicate=0, wide=0, false_upright=0, false_beam=0, rear=0, behind=0
)
HIDDEN = (1, 1)


def overhung(footage: synth.Footage) -> list[Feature]:
    """The features where all frames together show all of them, and goods stand out before the upper edge of one beam."""
    lower = {
        (feature.frame, feature.instance, feature.part.split()[-1]): feature
        for feature in footage.features
        if footage.truth[id(feature)] == HIDDEN and feature.part.startswith("lower")
    }
    found = []
    for feature in footage.features:
        if footage.truth[id(feature)] == HIDDEN and feature.part.startswith("upper"):
            below = lower[feature.frame, feature.instance, feature.part.split()[-1].replace("upper", "lower")]
            share = 0.3 + 0.6 * ((7 * feature.frame) % 10) / 10
            pixels = below.pixels + share * (feature.pixels - below.pixels)
            found.append(replace(feature, pixels=pixels, expected=True))
        else:
            found.append(replace(feature, expected=True))
    return found


def test_a_beam_whose_upper_edge_goods_hide_is_tracked_by_its_lower_one() -> None:
    rng = np.random.default_rng(3)
    rack = synth.random_rack(rng, 3, bridge=False)
    footage = synth.footage(rack, rng, (synth.Pass(rate=4, speed=0.9, distance=1.7),), CLEAN)
    tracks = track_structures(overhung(footage), footage.facts, attitudes=footage.attitudes)
    edges = {tuple(track.place[key] for key in ("bay", "beam", "edge")) for track in tracks if track.label == "beam"}
    every = {
        (section + 1, beam + 1, edge)
        for section, count in enumerate(rack.counts)
        for beam in range(count)
        for edge in ("lower", "upper")
    }
    assert every - edges == {(HIDDEN[0] + 1, HIDDEN[1] + 1, "upper")}
