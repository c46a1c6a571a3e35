"""Edges drawn into panoramas at known places, as a camera with blur, noise and a tone curve shows them."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from savmap.geometry import pinhole, sphere
from savmap.geometry.lines import Lines
from savmap.types import Floats, Panorama, ViewSpec
from savmap.vision import subpixel
from savmap.vision.subpixel import RADIANCE, Bools, Edges, Subpixel

HEIGHT = 512
SPEC = ViewSpec("face", yaw_deg=20.0, pitch_deg=4.0, roll_deg=-2.0, hfov_deg=100.0, width=320, height=240)
PANORAMA_PX = 0.7  # of a view pixel, about
Scene = Callable[[Floats, Floats], Floats]


@dataclass(frozen=True)
class Strip:
    """A level strip in the view: its upper edge v = top + slope (u - 160), its thickness, and its brightness."""

    top: float
    slope: float = 0.0
    thickness: float = 14.0
    bright: float = 0.5

    def below_top(self, u: Floats, v: Floats) -> Floats:
        """How far points lie below the upper edge."""
        below: Floats = v - self.top - self.slope * (u - 160)
        return below


STRIPS = [
    Strip(30.3, 0.01),
    Strip(65.8, -0.02),
    Strip(101.1, 0.03),
    Strip(140.45, 0.002),
    Strip(177.7),
    Strip(211.2, -0.04),
]


def filled(strips: Sequence[Strip], background: float = 0.1) -> Scene:
    def brightness(u: Floats, v: Floats) -> Floats:
        seen = np.full(u.shape, background)
        for strip in strips:
            below = strip.below_top(u, v)
            seen[(below > 0) & (below < strip.thickness)] = strip.bright
        return seen

    return brightness


def as_assumed(radiance: Floats) -> Floats:
    grey: Floats = np.interp(radiance, RADIANCE, np.arange(256))
    return grey


def plain_gamma(radiance: Floats) -> Floats:
    grey: Floats = 255 * np.clip(radiance, 0, 1) ** (1 / 2.2)
    return grey


def photographed(
    scene: Scene,
    spec: ViewSpec = SPEC,
    blur: float = 0.6,
    noise: float = 1.5,
    seed: int = 0,
    tone: Callable[[Floats], Floats] = as_assumed,
) -> Panorama:
    """Light is mixed over pixels (9 rays each) and blurred by the lens; then come the tone curve, noise and rounding."""
    radiance = np.zeros((HEIGHT, 2 * HEIGHT))
    v, u = np.mgrid[HEIGHT // 4 : 3 * HEIGHT // 4, 0 : 2 * HEIGHT].astype(np.float64)
    offsets = [(a / 3, b / 3) for a in (-1, 0, 1) for b in (-1, 0, 1)]
    for a, b in offsets:
        rays = sphere.rays_from_panorama_pixels(np.stack([u + a, v + b], axis=-1), HEIGHT) @ spec.rig_from_view
        ahead = rays[..., 2] > 0.3
        pixels = pinhole.project(rays[ahead], spec.camera)
        radiance[HEIGHT // 4 : 3 * HEIGHT // 4][ahead] += scene(pixels[:, 0], pixels[:, 1]) / len(offsets)
    wrapped = cv2.GaussianBlur(np.hstack([radiance, radiance[:, :32]]), (0, 0), blur)
    radiance = np.hstack([wrapped[:, -32:], wrapped[:, 32:-32]])
    grey = tone(radiance) + np.random.default_rng(seed).normal(0, noise, radiance.shape)
    return Panorama(0, 0.0, np.repeat(np.clip(np.round(grey), 0, 255).astype(np.uint8)[..., None], 3, axis=2))


def edges_of(strips: Sequence[Strip], off: Floats | float = 0.8, flank: Floats | float = 0.0) -> Edges:
    """Upper, then lower edges as masks have them: `off` pixels too far outside."""
    count = 2 * len(strips)
    inside = np.repeat([1.0, -1.0], len(strips))
    slopes = np.tile([strip.slope for strip in strips], 2)
    zeros = np.zeros(count)
    lines = Lines(
        zeros + 160,
        slopes,
        truth_of(strips) - inside * off,
        zeros + 1e-6,
        zeros + 0.01,
        zeros + 20,
        zeros + 300,
        zeros + 280,
    )
    thickness = np.tile([strip.thickness for strip in strips], 2)
    return Edges(lines, zeros + 20, zeros + 300, inside, thickness, zeros + flank, stands=False)


def measured(panorama: Panorama, spec: ViewSpec, edges: Edges, settings: Subpixel | None = None) -> tuple[Lines, Bools]:
    return subpixel.measured(panorama, spec, [edges], settings)[0]


def truth_of(strips: Sequence[Strip]) -> Floats:
    """Rows of the upper, then the lower edges at u = 160."""
    return np.array([strip.top for strip in strips] + [strip.top + strip.thickness for strip in strips])


def errors(lines: Lines, strips: Sequence[Strip], u: float = 160.0) -> Floats:
    slopes = np.tile([strip.slope for strip in strips], 2)
    wrong: Floats = lines.at(u) - truth_of(strips) - slopes * (u - 160)
    return wrong


def outward(wrong: Floats) -> Floats:
    half = len(wrong) // 2
    return np.concatenate([-wrong[:half], wrong[half:]])
