"""What varies from scene to scene in the path-traced pictures: surfaces' wear, light, camera. Two styles, never mixed.

Style 2 (`--look 2`) is for training. Style 3 is for measuring only: see docs/training-pictures.md for what it withholds
from training.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from savmap.types.scenes import Box

Color = tuple[float, float, float]
Rng = np.random.Generator

_WATTS_PER_RADIANCE_M2 = float(np.pi)


@dataclass(frozen=True)
class Wear:
    """Surfaces of one scene: shares 0..1 unless a unit is named."""

    dirt: float
    rust: float
    scratches: float
    bump: float
    hole_columns: int
    hole_size: float
    labels: float
    print_color: Color
    floor_gloss: float
    slab_m: float
    marble: float


@dataclass(frozen=True)
class Fill:
    """A large lamp that no camera sees, facing down: `place` (m) in the world, its sides along x and z (m), its
    power."""

    place: Color
    sides_m: tuple[float, float]
    watts: float
    color: Color


@dataclass(frozen=True)
class Light:
    """`lamp_gain` multiplies lamps' emission; the sun, if any, comes through roof lights `pitch_m` apart."""

    lamp_gain: float
    lamp_color: Color
    ambient: float
    ambient_color: Color
    fills: tuple[Fill, ...]
    sun: float = 0.0
    sun_towards: Color = (0.0, -1.0, 0.0)
    pitch_m: float = 6.0


@dataclass(frozen=True)
class Lens:
    """`brightness`: the picture's median in stops above middle grey; `f_stop` 0: all in focus; `travel_m` while
    exposed.

    `softness`: the factor by which the picture is coarser than its pixels; `noise` and `vignette` 0..1; `quality`: a
    JPEG that the picture went through before it was saved, 0 for none.
    """

    view_transform: str
    contrast: str
    brightness: float
    f_stop: float
    travel_m: float
    softness: float
    noise: float
    vignette: float
    quality: int
    tint: Color


@dataclass(frozen=True)
class RenderStyle:
    """All that the renderer draws at random for one scene, apart from the scene itself and its colours."""

    number: int
    wear: Wear
    light: Light
    lens: Lens


def kelvin(rng: Rng, low: float, high: float) -> Color:
    """A white between warm (0) and cold (1) at a random place between `low` and `high`."""
    warm, cold = np.array([1.0, 0.76, 0.5]), np.array([0.72, 0.88, 1.0])
    red, green, blue = (warm + (cold - warm) * rng.uniform(low, high)).tolist()
    return red, green, blue


def _chance(rng: Rng, share: float, value: float) -> float:
    return value if rng.uniform() < share else 0.0


def _fill(rng: Rng) -> Fill:
    place = (float(rng.uniform(-3, 14)), float(rng.uniform(2.5, 7)), float(rng.uniform(0.8, 1.8)))
    side = float(rng.uniform(0.6, 4))
    return Fill(place, (side, min(side, 1.5)), float(np.exp(rng.uniform(3.0, 5.5))), kelvin(rng, 0, 1))


def _wear(rng: Rng) -> Wear:
    return Wear(
        dirt=float(rng.uniform(0, 0.7)),
        rust=_chance(rng, 0.3, float(rng.uniform(0.1, 0.6))),
        scratches=_chance(rng, 0.7, float(rng.uniform(0.1, 0.8))),
        bump=float(rng.uniform(0.1, 0.9)),
        hole_columns=int(rng.integers(1, 3)),
        hole_size=float(rng.uniform(0.25, 0.6)),
        labels=_chance(rng, 0.7, float(rng.uniform(0.1, 0.9))),
        print_color=(0.85, 0.85, 0.8) if rng.uniform() < 0.6 else (0.8, 0.62, 0.05),
        floor_gloss=float(rng.uniform(0.15, 0.8)),
        slab_m=float(rng.uniform(2.5, 6)),
        marble=0.0,
    )


def _light(rng: Rng) -> Light:
    fills = tuple(_fill(rng) for _ in range(int(rng.integers(0, 4))))
    return Light(
        lamp_gain=float(np.exp(rng.uniform(-0.7, 1.0))),
        lamp_color=kelvin(rng, 0.2, 1),
        ambient=float(np.exp(rng.uniform(-4, -0.5))),
        ambient_color=kelvin(rng, 0.3, 1),
        fills=fills,
    )


def _lens(rng: Rng) -> Lens:
    transform = str(rng.choice(["Standard", "AgX", "Filmic", "Khronos PBR Neutral"], p=[0.35, 0.3, 0.2, 0.15]))
    contrast = str(rng.choice(["None", "Medium High Contrast", "High Contrast", "Medium Low Contrast"]))
    return Lens(
        view_transform=transform,
        contrast=contrast,
        brightness=float(np.clip(rng.normal(0, 0.6), -1.5, 1.1)),
        f_stop=_chance(rng, 0.12, float(rng.uniform(0.25, 0.9))),
        travel_m=_chance(rng, 0.12, float(rng.uniform(0.004, 0.02))),
        softness=float(rng.uniform(1.2, 1.6)),
        noise=_chance(rng, 0.3, float(rng.uniform(0, 0.5))),
        vignette=_chance(rng, 0.3, float(rng.uniform(0, 0.4))),
        quality=int(_chance(rng, 0.3, float(rng.integers(60, 90)))),
        tint=(1.0, float(rng.uniform(0.94, 1.03)), float(rng.uniform(0.85, 1.12))),
    )


def _held_out_wear(rng: Rng) -> Wear:
    return Wear(
        dirt=float(rng.uniform(0.2, 0.9)),
        rust=0.0,
        scratches=0.0,
        bump=float(rng.uniform(0.5, 1.0)),
        hole_columns=3,
        hole_size=float(rng.uniform(0.15, 0.3)),
        labels=float(rng.uniform(0.2, 0.9)),
        print_color=(0.02, 0.35, 0.12) if rng.uniform() < 0.5 else (0.6, 0.03, 0.05),
        floor_gloss=float(rng.uniform(0.05, 0.95)),
        slab_m=float(rng.uniform(0.4, 1.2)),
        marble=1.0,
    )


def _held_out_light(rng: Rng) -> Light:
    slant = rng.uniform([-0.7, 0, -0.35], [0.7, 0, 0.35])
    return Light(
        lamp_gain=float(np.exp(rng.uniform(-1.5, 0.3))),
        lamp_color=(0.75, 1.0, 0.85) if rng.uniform() < 0.4 else kelvin(rng, 0.6, 1.2),
        ambient=float(np.exp(rng.uniform(-3, -1))),
        ambient_color=(0.55, 0.72, 1.0),
        fills=(),
        sun=float(np.exp(rng.uniform(1.5, 3.5))),
        sun_towards=(float(slant[0]), -1.0, float(slant[2])),
        pitch_m=float(rng.uniform(1.5, 4)),
    )


def _held_out_lens(rng: Rng) -> Lens:
    return Lens(
        view_transform=str(rng.choice(["ACES 1.3", "ACES 2.0"])),
        contrast="None",
        brightness=float(np.clip(rng.normal(0, 0.6), -1.5, 1.1)),
        f_stop=0.0,
        travel_m=0.0,
        softness=float(rng.uniform(1.1, 1.8)),
        noise=float(rng.uniform(0.1, 0.6)),
        vignette=float(rng.uniform(0.2, 0.8)),
        quality=int(rng.integers(35, 70)),
        tint=(float(rng.uniform(0.9, 1.1)), 1.0, float(rng.uniform(0.8, 1.2))),
    )


def draw_style(number: int, rng: Rng) -> RenderStyle:
    """A random style of family 2 or 3. Raises ValueError for another number."""
    if number == 2:
        return RenderStyle(2, _wear(rng), _light(rng), _lens(rng))
    if number == 3:
        return RenderStyle(3, _held_out_wear(rng), _held_out_light(rng), _held_out_lens(rng))
    raise ValueError(f"the path tracer has looks 2 and 3, not {number}")


def _line(lamps: Sequence[Box], x: tuple[float, float], gain: float, color: Color) -> list[Fill]:
    """One lamp over the part of a line's lamps between `x`, as strong as they are together."""
    within = [lamp for lamp in lamps if x[0] <= lamp.center[0] <= x[1]]
    if not within:
        return []
    power = sum(lamp.material.emission * float(lamp.size[0] * lamp.size[2]) for lamp in within)
    bottom = min(float(lamp.center[1] - lamp.size[1] / 2) for lamp in within)
    place = ((x[0] + x[1]) / 2, bottom - 0.02, float(within[0].center[2]))
    return [Fill(place, (x[1] - x[0], float(within[0].size[2])), gain * power * _WATTS_PER_RADIANCE_M2, color)]


def area_lamps(boxes: Sequence[Box], gain: float, color: Color, rng: Rng) -> list[Fill]:
    """Area lamps for the luminous boxes with a label, by lines of one z; each line in two parts of unequal strength."""
    lamps = [box for box in boxes if box.material.emission > 0 and box.face_labels]
    fills: list[Fill] = []
    for z in sorted({round(float(lamp.center[2]), 2) for lamp in lamps}):
        line = [lamp for lamp in lamps if abs(lamp.center[2] - z) < 0.02]
        ends = np.array([[b.center[0] - b.size[0] / 2, b.center[0] + b.size[0] / 2] for b in line])
        left, right = float(ends.min()), float(ends.max())
        cut = float(rng.uniform(left, right))
        for part in ((left, cut), (cut, right)):
            fills += _line(line, part, gain * float(np.exp(rng.normal(0, 0.4))), color)
    return fills
