"""Compact lamps of which a part is hidden, by the side that shows and the others' size."""

import numpy as np

from savmap.plugin import sightings
from savmap.types import Feature
from savmap_lights.space.partial import completed
from savmap_lights.tracking import MAX_SLOPE

from . import drawn_ceiling as drawn

HALF = 0.12


def with_hidden(hidden: int, share: float = 0.4) -> list[Feature]:
    """Features of three lamps; of those seen left of the picture's middle in the first frames, the right part looks like the ceiling."""
    features = []
    for frame, pose in enumerate(drawn.path().world_from_rig):
        cut = HALF * (1 - 2 * share) if frame < hidden else HALF
        lamps = [
            drawn.strip(1.0 - HALF, 1.0 + cut),
            drawn.strip(2.5 - HALF, 2.5 + HALF),
            drawn.strip(4.0 - HALF, 4.0 + HALF),
        ]
        grey = drawn.picture(lamps, pose)
        features += drawn.extract_features(drawn.view_of(grey, frame), drawn.seen(grey, False))
    return features


def test_both_places_of_a_hidden_lamp_are_tried() -> None:
    features = with_hidden(hidden=6)
    seen = sightings(features, drawn.facts(), drawn.path(), upwards=True, max_slope=MAX_SLOPE)
    whole = completed(features, seen, drawn.HEIGHT_M, drawn.LINE_Z_M)
    again = sightings(whole, drawn.facts(), drawn.path(), upwards=True, max_slope=MAX_SLOPE)
    at = again.at(drawn.HEIGHT_M)[again.of_part("centre") & (again.frames < 6), 0]
    tried = at[np.abs(at - 1.0) < 0.3]
    assert (np.abs(tried - 1.0) < 0.015).sum() == 6
    assert len(tried) == 12


def test_whole_lamps_stay_as_they_are() -> None:
    features = with_hidden(hidden=0)
    seen = sightings(features, drawn.facts(), drawn.path(), upwards=True, max_slope=MAX_SLOPE)
    whole = completed(features, seen, drawn.HEIGHT_M, drawn.LINE_Z_M)
    assert [f.part for f in whole] == [f.part for f in features]
    assert np.array_equal([f.pixels[0] for f in whole], [f.pixels[0] for f in features])


def test_what_shines_beside_a_lamp_along_the_line_is_no_part_of_it() -> None:
    features = []
    for frame, pose in enumerate(drawn.path().world_from_rig):
        lamps = [drawn.strip(x - HALF, x + HALF) for x in (1.0, 2.5, 4.0)]
        if frame < 6:
            lamps[1][2:, 2] += 0.05
        grey = drawn.picture(lamps, pose)
        features += drawn.extract_features(drawn.view_of(grey, frame), drawn.seen(grey, False))
    seen = sightings(features, drawn.facts(), drawn.path(), upwards=True, max_slope=MAX_SLOPE)
    whole = completed(features, seen, drawn.HEIGHT_M, drawn.LINE_Z_M)
    again = sightings(whole, drawn.facts(), drawn.path(), upwards=True, max_slope=MAX_SLOPE)
    at = again.at(drawn.HEIGHT_M)[again.of_part("centre") & (again.frames < 6)]
    joined = at[np.abs(at[:, 0] - 2.5) < 0.3]
    assert len(joined) == 6
    np.testing.assert_allclose(joined, np.tile([2.5, drawn.LINE_Z_M], (6, 1)), atol=0.01)
