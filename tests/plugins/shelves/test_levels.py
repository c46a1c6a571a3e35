"""What counts as a beam level: support over the frames, and the floor."""

import numpy as np
import synth

from savmap.geometry import pinhole
from savmap.types import Feature
from savmap_shelves.levels import _support
from savmap_shelves.tracking import summary, track_structures

CLEAN = synth.Faults(
    noise_px=0.2, miss_upright=0, miss_beam=0, duplicate=0, wide=0, false_upright=0, false_beam=0, rear=0, behind=0
)
SHORT = synth.Pass(rate=4, speed=0.9, distance=1.7)


def footage_with_a_marking() -> synth.Footage:
    """A row whose second section shows a line below the floor's level in every frame, as a floor marking does."""
    rng = np.random.default_rng(3)
    rack = synth.random_rack(rng, 3, bridge=False)
    marked = np.vstack([[-0.6, -0.5], rack.beams[1]])
    rack = synth.Rack(rack.uprights, (rack.beams[0], marked, rack.beams[2]), rack.height)
    return synth.footage(rack, rng, (SHORT,), CLEAN)


def feet(footage: synth.Footage, height: float = 0.0) -> list[Feature]:
    """Where uprights end below, in every frame that shows it."""
    (name, view), found = next(iter(footage.facts.views.items())), []
    for frame, pose in enumerate(footage.world_from_rig):
        for number, x in enumerate(footage.rack.uprights.mean(axis=1)):
            place = (np.array([x, height, 0.0]) - pose[:3, 3]) @ pose[:3, :3] @ view.rig_from_view
            pixel = pinhole.project(place, view.camera)
            if place[2] > 0 and (pixel > 0).all() and (pixel < [view.width, view.height]).all():
                found.append(Feature(frame, name, "upright", "foot", number, pixel[None], np.eye(2)[None] * 4.0))
    return found


def test_no_beam_lies_below_the_feet_of_the_uprights() -> None:
    footage = footage_with_a_marking()
    levels = ", ".join(str(count) for count in footage.rack.counts)
    blind = track_structures(footage.features, footage.facts, attitudes=footage.attitudes)
    assert summary(blind)["levels"] == levels, "nothing says where the floor is: the marking looks like a beam"
    seen = track_structures([*footage.features, *feet(footage)], footage.facts, attitudes=footage.attitudes)
    counts = [count - (section == 1) for section, count in enumerate(footage.rack.counts)]
    assert summary(seen)["levels"] == ", ".join(map(str, counts))


def test_support_of_a_beam_hidden_in_part_is_more_than_of_one_that_comes_and_goes() -> None:
    shown = np.ones((2, 20), dtype=np.bool_)
    hits = np.array([np.ones(20), np.arange(20) % 4 == 0], dtype=np.bool_)
    cover = hits * np.array([[0.25], [1.0]])
    hidden, passing = _support(hits, cover, shown)
    assert np.isclose(hidden, np.cbrt(0.25))
    assert np.isclose(passing, np.cbrt(0.25**3))
    assert np.allclose(_support(np.ones((1, 4), dtype=np.bool_), np.ones((1, 4)), shown[:1, :4]), 1.0)
