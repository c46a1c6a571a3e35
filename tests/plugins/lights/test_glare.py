"""Lamps on a ceiling that is overexposed: what tells them apart are the last levels below white, in the darkest colour."""

from collections.abc import Sequence

import numpy as np

from savmap.geometry.pinhole import project
from savmap.types import Detection, Feature, Floats, View
from savmap_lights.features import extract_features
from savmap_lights.picture.glare import glare_of
from savmap_lights.picture.seeds import seeds_of
from savmap_lights.picture.strips import strips, without_hidden_ends

from . import drawn_ceiling as drawn

POSE = drawn.path().world_from_rig[12]
X = float(POSE[0, 3])
WHITE = 254
GLARE = np.array([252.0, 251.0, 249.0])


def pixel(x: float) -> Floats:
    point = np.array([[x, drawn.HEIGHT_M, drawn.LINE_Z_M]])
    return project((point - POSE[:3, 3]) @ POSE[:3, :3] @ drawn.CEILING.rig_from_view, drawn.CEILING.camera)[0]


def pictured(lamps: Sequence[Floats], glare: Floats = GLARE, beside: Sequence[Floats] = ()) -> View:
    """A view of lamps, and of what is `beside` them, a little darker, on a ceiling of this colour, with noise."""
    lit = (drawn.picture(lamps, POSE).astype(np.float64) - drawn.DIM) / (drawn.BRIGHT - drawn.DIM)
    near = (drawn.picture(beside, POSE).astype(np.float64) - drawn.DIM) / (drawn.BRIGHT - drawn.DIM)
    ceiling = glare + near[..., None] * (252 - glare)
    image = ceiling + lit[..., None] * (WHITE - ceiling) + np.random.default_rng(1).normal(0, 1, (*lit.shape, 3))
    return View(drawn.CEILING, 0, 0.0, np.clip(np.round(image), 0, 255).astype(np.uint8))


def seen(lamp: Floats) -> list[Detection]:
    """What a network makes of the one lamp that it sees."""
    return drawn.seen(drawn.picture([lamp], POSE), False)


def found(features: Sequence[Feature], *parts: str) -> Floats:
    """Pixels (n, 2) of the parts, from the left."""
    pixels = np.array([f.pixels[0] for f in features if f.part in parts]).reshape(-1, 2)
    return pixels[np.argsort(pixels[:, 0])]


def test_a_compact_lamp_is_found_by_its_like() -> None:
    lamps = [drawn.strip(x - 0.1, x + 0.1) for x in (X - 1.2, X + 1.3)]
    centres = found(extract_features(pictured(lamps), seen(lamps[0])), "centre", "glimpse")
    assert np.abs(centres - [pixel(X - 1.2), pixel(X + 1.3)]).max() < 0.6


def test_a_strip_is_found_by_its_like() -> None:
    lamps = [drawn.strip(x - 0.4, x + 0.4) for x in (X - 1.2, X + 1.3)]
    ends = found(extract_features(pictured(lamps), seen(lamps[0])), "end a", "end b")
    assert np.abs(ends - [pixel(x) for x in (X - 1.6, X - 0.8, X + 0.9, X + 1.7)]).max() < 0.8


def test_what_adjoins_a_compact_lamp_is_no_part_of_it() -> None:
    lamp, purlin = drawn.strip(X - 0.1, X + 0.1), drawn.strip(X + 0.1, X + 0.16)
    centre = found(extract_features(pictured([lamp], beside=[purlin]), seen(lamp)), "centre", "glimpse")
    assert np.abs(centre - pixel(X)).max() < 0.8


def test_what_runs_across_below_a_line_of_light_is_no_end_of_it() -> None:
    # In the last levels below white the ceiling is as dark as a girder, which shows there as a joint does.
    lamp = drawn.strip(X - 1.8, X + 1.8)
    picture = drawn.picture([lamp], POSE, beams=[X + 0.5])
    grey, last = picture.astype(np.float32), np.where(picture > 200, 50, 0).astype(np.float32)
    girder = np.array([[x, 5.5, drawn.LINE_Z_M] for x in (X + 0.5, X + 0.7)])
    sides = project((girder - POSE[:3, 3]) @ POSE[:3, :3] @ drawn.CEILING.rig_from_view, drawn.CEILING.camera)
    for body in strips(last, seeds_of(last, drawn.seen(picture, False))):
        assert all(end is not None for end in body.ends)
        shown = without_hidden_ends(grey, body)
        hidden = np.array(shown.covered)[:, None, 0] - sides[:, 0]
        assert sum(end is not None for end in shown.ends) == 1
        assert np.abs(hidden).min() < 2


def test_a_dark_ceiling_and_a_skylight_glare_not() -> None:
    lamp = drawn.strip(X - 0.4, X + 0.4)
    skylight = drawn.strip(X - 1.5, X - 0.9)
    for view in (pictured([lamp], GLARE / 2), pictured([lamp, skylight], GLARE / 2)):
        grey = view.image.mean(axis=2).astype(np.float32)
        assert glare_of(view.image, grey, seen(lamp)) is None
