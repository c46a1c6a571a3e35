"""Tracking on random racks with all faults of detection: exact counts on every one, and on a row of the paper's size."""

import numpy as np
import pytest
import synth
from tracking_truth import counted, shares

from savmap_shelves.tracking import track_structures

pytestmark = pytest.mark.slow


@pytest.mark.parametrize("seed", range(20))
def test_random_short_rows_are_counted_exactly(seed: int) -> None:
    rng = np.random.default_rng(1000 + seed)
    rack = synth.random_rack(rng, int(rng.integers(2, 4)), (3, 7))
    one = synth.Pass(
        rate=float(rng.uniform(4, 6)),
        speed=float(rng.uniform(0.8, 1.2)),
        distance=float(rng.uniform(1.5, 2.6)),
        direction=int(rng.choice([-1, 1])),
    )
    footage = synth.footage(rack, rng, (one,), known_travel=bool(seed % 3))
    tracks = track_structures(footage.features, footage.facts, attitudes=footage.attitudes if seed % 2 else None)
    assert counted(tracks) == (len(rack.uprights), rack.counts)
    kept, wrong = shares(footage, tracks)
    assert kept > 0.8
    assert wrong < 0.06


def test_a_row_of_the_papers_size() -> None:
    rng = np.random.default_rng(0)
    rack = synth.random_rack(rng, 15, (5, 11))
    footage = synth.footage(rack, rng, (synth.Pass(rate=3, speed=0.9, distance=1.6),))
    tracks = track_structures(footage.features, footage.facts, attitudes=footage.attitudes)
    assert counted(tracks) == (16, rack.counts)
