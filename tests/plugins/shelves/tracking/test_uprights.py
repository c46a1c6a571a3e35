"""Which uprights at the ends of a row are of this row, and which come into view behind its end."""

from dataclasses import replace

import numpy as np
import pytest
import synth
from tracking_truth import counted

from savmap_shelves.tracking import track_structures

CLEAN = synth.Faults(
    noise_px=0.2, miss_upright=0, miss_beam=0, duplicate=0, wide=0, false_upright=0, false_beam=0, rear=0, behind=0
)
SHORT = synth.Pass(rate=4, speed=0.9, distance=1.7)


def row(share: float, beams: float, behind: float) -> synth.Rack:
    """Four bays, the last upright narrower than the others by a share, and its bay's beams lower; or as far behind the face."""
    x = 2.6 * np.arange(5)[:, None] + np.array([0.0, 0.1])
    x[-1, 1] = x[-1, 0] + 0.1 * share
    bottoms = np.array([0.3, 1.6, 2.9, 4.2])
    levels = [np.column_stack([bottoms, bottoms + height]) for height in (0.12, 0.12, 0.12, 0.12 * beams)]
    return synth.Rack(x, tuple(levels), 6.0, behind)


@pytest.mark.parametrize(
    ("share", "beams", "behind", "uprights"),
    [
        (1.0, 1.0, 0.0, 5),
        (0.6, 1.0, 0.0, 5),
        (0.6, 0.6, 0.0, 5),
        (0.6, 0.6, 0.1, 5),
        (0.9, 0.9, 1.2, 4),
        (1.7, 1.7, 1.2, 4),
    ],
    ids=[
        "like the others",
        "seen in part",
        "a lighter rack",
        "a lighter rack a bit behind",
        "farther away",
        "farther away and as much larger",
    ],
)
def test_a_narrow_upright_at_the_end_of_a_row(share: float, beams: float, behind: float, uprights: int) -> None:
    footage = synth.footage(row(share, beams, behind), np.random.default_rng(3), (SHORT,), CLEAN)
    assert counted(track_structures(footage.features, footage.facts, attitudes=footage.attitudes))[0] == uprights


@pytest.mark.parametrize("gap", [0.3, 0.45, 1.2, 3.2])
def test_two_racks_end_to_end_keep_both_their_uprights(gap: float) -> None:
    """A column of the hall, or a passage, stands between two racks of two bays each: the gap is a bay without beams."""
    ends = np.array([0.0, 2.6, 5.2, 5.3 + gap, 7.9 + gap, 10.5 + gap])
    bottoms = np.array([0.3, 1.6, 2.9, 4.2])
    levels, none = np.column_stack([bottoms, bottoms + 0.12]), np.zeros((0, 2))
    racks = synth.Rack(ends[:, None] + np.array([0.0, 0.1]), (levels, levels, none, levels, levels), 6.0)
    footage = synth.footage(racks, np.random.default_rng(3), (SHORT,), CLEAN)
    assert counted(track_structures(footage.features, footage.facts, attitudes=footage.attitudes)) == (
        6,
        [4, 4, 0, 4, 4],
    )


@pytest.mark.parametrize(("expected", "uprights"), [(False, 4), (True, 5)])
def test_an_upright_that_few_frames_show_is_one_where_all_frames_together_show_it(
    expected: bool, uprights: int
) -> None:
    footage = synth.footage(row(1.0, 1.0, 0.0), np.random.default_rng(3), (SHORT,), CLEAN)
    tracks = track_structures(footage.features, footage.facts, attitudes=footage.attitudes)
    (third,) = (track for track in tracks if track.name == "upright 3 / left / top")
    shown = len(third.frames)
    few = round(0.3 * shown)
    lost = {
        (feature.frame, feature.instance)
        for frame, pixel in list(zip(third.frames.tolist(), third.pixels, strict=True))[few:]
        for feature in footage.features
        if (feature.label, feature.part, feature.frame) == ("upright", "left", frame)
        and np.allclose(feature.pixels[0], pixel)
    }
    assert few >= 3
    assert len(lost) == shown - few
    features = [
        replace(feature, expected=expected)
        for feature in footage.features
        if feature.label != "upright" or (feature.frame, feature.instance) not in lost
    ]
    assert counted(track_structures(features, footage.facts, attitudes=footage.attitudes))[0] == uprights
