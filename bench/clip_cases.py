"""Ways in which a row's clip can be wrong, or harmlessly different, and what is to come of each: cases for `physics`.

`DRIVES` change a drive, and `camera_cases` are what real cameras give, on a cart or in a hand, of simulated rows, whose camera's path is given. Where the camera, or one of its two lenses, stands
elsewhere, the aisle is taken for a box of two faces, a floor and a ceiling: what lies in the faces and on the floor is displaced rightly, what
lies behind the faces a little too much.
"""

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from bench.clips import (
    Frames,
    Image,
    cropped,
    eyes,
    lit,
    ordinary,
    out_of_focus,
    patched,
    sampled,
    seamed,
    smeared_lens,
    turned,
    two_fisheyes,
)
from savmap.geometry.pinhole import rig_from_view
from savmap.geometry.sphere import rays_from_panorama_pixels
from savmap.types import Floats


@dataclass(frozen=True)
class ClipCase:
    """A way to change a row's clip. `words`: of the true reason, one of them, where it may be caught; none where the map is to be trusted.
    `side`, `part`: the hand and the part of the clip (shares) that the site file says. `streams`, `degrees`: as `bench.clips.write` takes them."""

    name: str
    change: Callable[[Frames, Frames], Frames]
    words: tuple[str, ...] = ()
    side: Callable[[str], str] = field(default=lambda side: side)
    part: tuple[float, float] | None = None
    streams: int = 1
    degrees: float = 0.0


def again(frames: Frames, pictures: Sequence[Image]) -> Frames:
    """Pictures at the rate of the clip."""
    step = frames[1][0] - frames[0][0]
    return [(index * step, picture) for index, picture in enumerate(pictures)]


def of(change: Callable[[Image], Image]) -> Callable[[Frames, Frames], Frames]:
    """A change of every picture."""
    return lambda frames, _: [(stamp, change(picture)) for stamp, picture in frames]


def ordered(order: Callable[[list[Image]], list[Image]]) -> Callable[[Frames, Frames], Frames]:
    """A change of the pictures' order and number."""
    return lambda frames, _: again(frames, order([picture for _, picture in frames]))


def from_middle(change: Callable[[Image], Image]) -> Callable[[Frames, Frames], Frames]:
    """A change from the middle of the clip on."""
    return lambda frames, _: [
        (stamp, change(picture) if index >= len(frames) // 2 else picture)
        for index, (stamp, picture) in enumerate(frames)
    ]


def without(frames: Frames, stamped: bool) -> Frames:
    """Without a sixth of the frames, in the middle; `stamped`: the others keep their times."""
    middle, count = len(frames) // 2, len(frames) // 6
    kept = [*frames[:middle], *frames[middle + count :]]
    return kept if stamped else again(frames, [picture for _, picture in kept])


def u_turn(pictures: list[Image]) -> list[Image]:
    """To the end, round, and back."""
    turning = [turned(angle)(pictures[-1]) for angle in range(20, 180, 20)]
    return [*pictures, *turning, *map(turned(180), pictures[::-1])]


def smeared(pictures: list[Image]) -> list[Image]:
    """With one frame that shows nothing."""
    grey = np.random.default_rng(3).integers(0, 255, pictures[0].shape, dtype=np.uint8)
    return [*pictures[: len(pictures) // 2], grey, *pictures[len(pictures) // 2 + 1 :]]


def other_hand(side: str) -> str:
    return "left" if side == "right" else "right"


def hesitating(pictures: list[Image]) -> list[Image]:
    """Back by six frames half-way, and on."""
    half = len(pictures) // 2
    return [*pictures[:half], *pictures[half - 6 : half][::-1], *pictures[half - 6 :]]


def standing(pictures: list[Image], count: int) -> list[Image]:
    """Half-way the camera stands for so many frames."""
    half = len(pictures) // 2
    return [*pictures[:half], *[pictures[half]] * count, *pictures[half:]]


def cut_to(frames: Frames, other: Frames) -> Frames:
    """From the middle on, another row."""
    return again(frames, [picture for _, picture in [*frames[: len(frames) // 2], *other[5:25]]])


BACK, CUT, MISSING = ("goes back the way it came",), ("a cut", "after a cut"), ("frames are missing", "frames seem")
TURNED = ("turned away",)
CONTRADICTED = ("contradict", "heights", "bays were found", "reference", "rest says")
BADLY_SEEN = ("seen", "measured", "fit", "support", "part", "bays")
CLIP_DOUBTED = ("contradict", "bays were found", "no such thing", "part", "rest says", "height", "fit", "seen")
ANY = ("",)
"""A camera that is held so badly may be caught for whatever reason."""
DRIVES = (
    ClipCase("as it is", of(lambda picture: picture)),
    ClipCase("turned by 70 degrees", of(turned(70))),
    ClipCase("pitched by 15 degrees", of(turned(0, 15, 5))),
    ClipCase("upside down", of(turned(0, 0, 180)), ("upside down", "no building", "no structure", "tilted", "contradict", "bays were found")),
    ClipCase("reversed", ordered(lambda p: p[::-1]), side=other_hand),
    ClipCase("reversed, side as it was", ordered(lambda p: p[::-1]), (*CONTRADICTED, "not on the", "side")),
    ClipCase("mirrored", of(lambda p: p[:, ::-1]), (*CONTRADICTED, "do not agree", "panorama")),
    ClipCase("there and back", ordered(lambda p: [*p, *p[::-1]]), BACK),
    ClipCase("there and a third back", ordered(lambda p: [*p, *p[::-1][: len(p) // 3]]), BACK),
    ClipCase("there, round and back", ordered(u_turn), (*BACK, *TURNED)),
    ClipCase("hesitates", ordered(hesitating), BACK),
    ClipCase("turns away at the end", ordered(lambda p: [*p, *[turned(a)(p[-1]) for a in range(15, 106, 15)]]), TURNED),
    ClipCase("stands for ten frames", ordered(lambda p: standing(p, 10))),
    ClipCase("stands most of the time", ordered(lambda p: standing(p, 2 * len(p))), ("stands for",)),
    ClipCase("every frame twice", ordered(lambda p: [picture for picture in p for _ in (0, 1)])),
    ClipCase("gap, times kept", lambda frames, _: without(frames, True), MISSING),
    ClipCase("gap, times rewritten", lambda frames, _: without(frames, False), MISSING),
    ClipCase("three frames missing", ordered(lambda p: [*p[: len(p) // 2], *p[len(p) // 2 + 3 :]]), MISSING),
    ClipCase("cut to another row", cut_to, CUT),
    ClipCase("cut, camera turned round", from_middle(turned(180)), CUT),
    ClipCase("turned by 90 degrees half-way", from_middle(turned(90)), (*CUT, *TURNED)),
    ClipCase("turned by 20 degrees half-way", from_middle(turned(20)), (*CUT, *TURNED)),
    ClipCase("cropped and stretched", of(cropped(0.08)), ("whole equirectangular", "whole panorama", "no panorama", "contradict", "rest says", "fit")),
    ClipCase("smear on a lens, left", of(smeared_lens(-90, 50, 8.0)), BADLY_SEEN),
    ClipCase("smear on a lens, right", of(smeared_lens(90, 50, 8.0)), BADLY_SEEN),
    ClipCase("out of focus", of(out_of_focus), ("seen", "measured", "fit", "part", "bays")),
    ClipCase("one smeared frame", ordered(smeared)),
    ClipCase("step of exposure", from_middle(lit(1.6))),
    ClipCase("dark", of(lit(0.3, 3.0))),
    ClipCase("tripod and logo", of(patched)),
    ClipCase("lenses exposed differently", of(seamed)),
    ClipCase("sides swapped", of(lambda p: p), CLIP_DOUBTED, side=other_hand),
    ClipCase("the first half only", of(lambda p: p), CLIP_DOUBTED, part=(0.0, 0.5)),
    ClipCase("the first two thirds only", of(lambda p: p), CLIP_DOUBTED, part=(0.0, 2 / 3)),
    ClipCase("VR180 side by side", of(eyes(np.pi, False)), ("side by side",)),
    ClipCase("stereo side by side", of(eyes(2 * np.pi, False)), ("side by side",)),
    ClipCase("stereo above one another", of(eyes(2 * np.pi, True)), ("one eye above",)),
    ClipCase("two fisheyes", of(two_fisheyes), ("fisheye",)),
    ClipCase("ordinary video", of(ordinary), ("no panorama",)),
    ClipCase("flag: turn by 180 degrees", of(lambda p: p), ("to be turned",), degrees=180.0),
    ClipCase("two streams", of(lambda p: p), ("2 video streams",), streams=2),
)  # fmt: skip

Rays = NDArray[np.floating[Any]]
CEILING_M = 7.0
BENT = ("bent at a seam", "panorama")


@dataclass(frozen=True, eq=False)
class Rig:
    """The camera's poses `world_from_rig` (n, 4, 4), m, y up, and the faces at both sides of its aisle (z, m)."""

    world_from_rig: Floats
    faces: tuple[float, float]

    @property
    def towards(self) -> Floats:
        """The way of the drive (3,), unit, in the world."""
        way = self.world_from_rig[-1, :3, 3] - self.world_from_rig[0, :3, 3]
        level: Floats = way * [1.0, 0.0, 1.0]
        return level / np.linalg.norm(level)


def load_rig(poses: Path) -> Rig:
    """The rig of a simulated row, from its `poses.json`."""
    content = json.loads(poses.read_text(encoding="utf-8"))
    poses_ = np.array([frame["world_from_rig"] for frame in content["frames"]])
    z = sorted(row["origin"][2] for row in content["rows"].values())
    here = float(np.median(poses_[:, 2, 3]))
    return Rig(poses_, (max(one for one in z if one < here), min(one for one in z if one > here)))


@lru_cache(maxsize=1)
def grid(height: int) -> NDArray[np.float32]:
    """Unit rays (height, 2 height, 3) of a panorama's pixels, in the rig's frame."""
    x, y = np.meshgrid(np.arange(2 * height), np.arange(height))
    return rays_from_panorama_pixels(np.dstack([x, y]).astype(float), height).astype(np.float32)


def seen_from(rig: Rig, index: int, rays: Rays, offset: Floats) -> Floats:
    """The directions (h, w, 3), in the rig's frame, of what a camera beside the rig by `offset` (3,) m of the world sees along `rays`."""
    pose, offset = rig.world_from_rig[index].astype(np.float32), np.asarray(offset, np.float32)
    world = rays.astype(np.float32) @ pose[:3, :3].T
    at = pose[:3, 3] + offset
    with np.errstate(divide="ignore"):
        z = np.where(world[..., 2] < 0, (rig.faces[0] - at[2]) / world[..., 2], (rig.faces[1] - at[2]) / world[..., 2])
        y = np.where(world[..., 1] < 0, -at[1] / world[..., 1], (CEILING_M - at[1]) / world[..., 1])
    far = np.minimum(np.minimum(np.abs(z), np.abs(y)), 50.0)[..., None]
    return np.asarray((world * far + offset) @ pose[:3, :3])


Change = Callable[[Image, int], Image]


def shown(values: Floats) -> Image:
    """A picture of grey values, which may lie beyond 0..255."""
    return np.asarray(np.clip(values, 0, 255), np.uint8)


def each(change: Change) -> Callable[[Frames, Frames], Frames]:
    """A change of every picture, which knows the frame's number."""
    return lambda frames, _: [(stamp, change(picture, index)) for index, (stamp, picture) in enumerate(frames)]


def moved(rig: Rig, offsets: Floats, turns: Sequence[Floats]) -> Change:
    """As by a camera beside its path by `offsets` (n, 3) m of the world, turned by `turns` (3, 3) in the rig's frame."""

    def change(picture: Image, index: int) -> Image:
        rays = grid(len(picture)) @ turns[index].T.astype(np.float32)
        return sampled(picture, seen_from(rig, index, rays, offsets[index]))

    return change


def about(rig: Rig, index: int, axis: Floats, degrees: float) -> Floats:
    """A turn (3, 3) in the rig's frame about an axis (3,) of the world."""
    inside = rig.world_from_rig[index, :3, :3].T @ axis
    return np.asarray(cv2.Rodrigues(np.radians(degrees) * inside)[0])


def walked(rig: Rig, bob_m: float, sway_deg: float, steps: float = 9.3) -> Change:
    """Carried by somebody who walks: up and down, to and fro, rolling and nodding, so many steps in the clip."""
    count = len(rig.world_from_rig)
    phase = 2 * np.pi * steps * np.arange(count) / count
    side = np.cross(rig.towards, [0.0, 1.0, 0.0])
    offsets = bob_m * np.sin(2 * phase)[:, None] * [0.0, 1.0, 0.0] + bob_m * np.sin(phase)[:, None] * side
    rolls, nods = sway_deg * np.sin(phase + 0.4), sway_deg / 2 * np.sin(2 * phase + 1.0)
    turns = [
        about(rig, index, rig.towards, rolls[index]) @ about(rig, index, side, nods[index]) for index in range(count)
    ]
    return moved(rig, offsets, turns)


def two_lenses(
    rig: Rig, apart_m: float, gain: float = 1.0, falloff: float = 0.0, fringe: float = 0.0, blend_deg: float = 2.0
) -> Change:
    """Two lenses back to back, `apart_m` from one another along the rig's z, which a stitcher does not bring together; the rear one brighter
    by `gain`; both darker by `falloff` at their edges, and red by a share `fringe` farther from their axes than blue."""

    def change(picture: Image, index: int) -> Image:
        rays = grid(len(picture))
        axis = rig.world_from_rig[index, :3, 2]
        off_deg = np.degrees(np.arccos(np.clip(np.abs(rays[..., 2:]), 0, 1)))
        dark = 1 - falloff * (off_deg / 90) ** 4
        both = []
        for sign, light in ((1.0, 1.0), (-1.0, gain)):
            seen = seen_from(rig, index, rays, sign * axis * apart_m / 2)
            lens = sampled(picture, seen) if not fringe else fringed(picture, seen, sign, fringe)
            both.append(light * dark * lens)
        front = np.clip(0.5 + (90 - np.degrees(np.arccos(np.clip(rays[..., 2:], -1, 1)))) / blend_deg, 0, 1)
        return shown(front * both[0] + (1 - front) * both[1])

    return change


def bent_lenses(rig: Rig, apart_m: float, fade_deg: float) -> Change:
    """Two lenses back to back along the drive, so that the seam crosses the face. The camera's program hides the step at the seam: it bends the
    pictures within `fade_deg` of it, from where one lens is to where the other is."""
    axis = rig.world_from_rig[0, :3, :3].T @ rig.towards

    def change(picture: Image, index: int) -> Image:
        rays = grid(len(picture))
        from_seam = 90 - np.degrees(np.arccos(np.clip(rays @ axis, -1, 1)))
        share = np.clip(from_seam / fade_deg, -1, 1)[..., None] / 2
        apart = apart_m * (rig.world_from_rig[index, :3, :3] @ axis)
        front, rear = (seen_from(rig, index, rays, side * apart) for side in (0.5, -0.5))
        return sampled(picture, front * (0.5 + share) + rear * (0.5 - share))

    return change


def fringed(picture: Image, rays: Floats, sign: float, share: float) -> Image:
    """Red a little farther from the lens's axis, blue a little nearer."""
    unit = rays / np.linalg.norm(rays, axis=2, keepdims=True)
    off = np.arccos(np.clip(sign * unit[..., 2:], -1, 1))
    out = []
    for channel, scale in enumerate((1 - share, 1.0, 1 + share)):
        wanted = off * scale
        across = unit[..., :2] / np.maximum(np.sin(off), 1e-6) * np.sin(wanted)
        out.append(sampled(picture, np.concatenate([across, sign * np.cos(wanted)], axis=2))[..., channel])
    return np.dstack(out)


def blurred_by_motion(rig: Rig, metres: float) -> Change:
    """What the camera passes while the shutter is open."""

    def change(picture: Image, index: int) -> Image:
        rays = grid(len(picture))
        shares = np.linspace(-0.5, 0.5, 5) * metres
        seen = [sampled(picture, seen_from(rig, index, rays, share * rig.towards)) for share in shares]
        return shown(np.mean(seen, axis=0))

    return change


def rolling(rig: Rig, late_m: float, turn_deg: float) -> Change:
    """Rows read out one after the other, from top to bottom, while the cart goes on by `late_m` and sways by `turn_deg`."""

    def change(picture: Image, index: int) -> Image:
        rays = grid(len(picture))
        late = (np.arange(len(picture)) + 0.5)[:, None, None] / len(picture) - 0.5
        seen = seen_from(rig, index, rays, np.zeros(3))
        moved_on = seen_from(rig, index, rays, late_m * rig.towards)
        swayed = about(rig, index, rig.towards, turn_deg * np.sin(1.7 * index)) - np.eye(3)
        mixed = seen + late * (moved_on - seen)
        return sampled(picture, mixed + late * (mixed @ swayed.T))

    return change


def stabilised(rig: Rig, drift_deg: float) -> Change:
    """The heading is kept while the rig turns, and drifts away over the clip."""
    count = len(rig.world_from_rig)
    up = np.array([0.0, 1.0, 0.0])
    heading = np.degrees(np.unwrap(np.arctan2(rig.world_from_rig[:, 0, 2], rig.world_from_rig[:, 2, 2])))
    turns = [about(rig, i, up, -(heading[i] - heading[0]) + drift_deg * i / count) for i in range(count)]
    return moved(rig, np.zeros((count, 3)), turns)


def painted(rig: Rig, azimuth_deg: float, wide_deg: float, reach_deg: tuple[float, float], colour: int) -> Change:
    """A dark shape that goes with the camera: `azimuth_deg` from the drive's way, between two elevations."""

    def change(picture: Image, index: int) -> Image:
        pose = rig.world_from_rig[0]
        world = grid(len(picture)) @ pose[:3, :3].T
        side = np.cross(rig.towards, [0.0, 1.0, 0.0])
        azimuth = np.degrees(np.arctan2(world @ side, world @ rig.towards))
        elevation = np.degrees(np.arcsin(np.clip(world[..., 1], -1, 1)))
        middle, half = np.mean(reach_deg), (reach_deg[1] - reach_deg[0]) / 2
        sway = 2 * np.sin(1.3 * index)
        across = ((azimuth - azimuth_deg - sway + 180) % 360 - 180) / (wide_deg / 2)
        inside = (np.abs(across) ** 3 + np.abs((elevation - middle) / half) ** 3 < 1)[..., None]
        cloth = colour + 12 * np.sin(elevation / 3)[..., None] * [1.0, 0.8, 1.2]
        return shown(np.where(inside, cloth, picture))

    return change


def below(limit_deg: float, blurred: bool) -> Change:
    """The nadir blurred by the camera, or covered by the cart."""

    def change(picture: Image, _: int) -> Image:
        top = round((0.5 + limit_deg / 180) * len(picture))
        copy = picture.copy()
        copy[top:] = cv2.GaussianBlur(picture, (0, 0), len(picture) / 20)[top:] if blurred else 35
        return copy

    return change


def tinted(strength: float, periods: float) -> Change:
    """White balance that drifts to and fro."""

    def change(picture: Image, index: int) -> Image:
        wave = strength * np.sin(2 * np.pi * periods * index / 40)
        return shown(picture * np.array([1 + wave, 1.0, 1 - wave]))

    return change


def pumping(strength: float, period: float) -> Change:
    """Exposure that falls where a lamp is overhead."""
    return lambda picture, index: shown(picture * np.exp(strength * np.sin(2 * np.pi * index / period)))


def banded(strength: float, bands: float) -> Change:
    """Bands of LED lamps across the rows of the sensor, which wander from frame to frame."""

    def change(picture: Image, index: int) -> Image:
        rows = np.arange(len(picture)) / len(picture)
        gain = 1 + strength * np.sin(2 * np.pi * (bands * rows + 0.37 * index))
        return shown(picture * gain[:, None, None])

    return change


def sharpened(amount: float, curve: float) -> Change:
    """As cameras develop: noise smeared away, edges sharpened with rims, contrast raised."""

    def change(picture: Image, _: int) -> Image:
        calm = cv2.bilateralFilter(picture, 5, 18, 3).astype(float)
        sharp = calm + amount * (calm - cv2.GaussianBlur(calm, (0, 0), 1.6))
        return shown(128 + (sharp - 128) * curve)

    return change


def resized(height: int) -> Change:
    """Of another size."""
    how = cv2.INTER_CUBIC
    return lambda picture, _: np.asarray(
        cv2.resize(picture, (2 * height, height), interpolation=how if height > len(picture) else cv2.INTER_AREA),
        np.uint8,
    )


def spots(picture: Image, _: int) -> Image:
    """Dust and a finger's mark on both lenses: small, dull, blurred."""
    copy = picture.astype(float)
    height, width = picture.shape[:2]
    x, y = np.meshgrid(np.arange(width) / width * 360 - 180, 90 - np.arange(height) / height * 180)
    dull = cv2.GaussianBlur(picture, (0, 0), height / 60) * 0.6 + 40.0
    for azimuth, elevation, wide in ((-75, -8, 7), (60, 10, 5), (110, -20, 9), (-120, 5, 4)):
        share = np.clip(1.6 - 1.6 * np.hypot(x - azimuth, y - elevation) / wide, 0, 1)[..., None] * 0.8
        copy = (1 - share) * copy + share * dull
    return shown(copy)


def carried(before: int, after: int, hand: bool) -> Callable[[Frames, Frames], Frames]:
    """Before and after the drive the camera is taken into the hand, which turns it any way, or a hand is before the lens."""

    def change(frames: Frames, _: Frames) -> Frames:
        rng = np.random.default_rng(8)

        def taken(picture: Image, strength: float) -> Image:
            yaw, pitch, roll = rng.normal(0, strength * np.array([40.0, 25.0, 25.0]))
            shaken = turned(float(yaw), float(pitch), float(roll))(picture)
            if hand:
                rows, columns = np.mgrid[0 : len(picture), 0 : 2 * len(picture)] / len(picture)
                palm = np.hypot((columns - 1.0) / 0.9, (rows - 0.55) / 0.45) < 0.75 + 0.1 * np.sin(9 * columns)
                shaken = np.where(palm[..., None], np.array([120, 80, 60]), shaken).astype(np.uint8)
            return shaken

        first = [taken(frames[0][1], 1.0 - 0.8 * index / max(before, 1)) for index in range(before)]
        last = [taken(frames[-1][1], 0.2 + 0.8 * index / max(after, 1)) for index in range(after)]
        return again(frames, [*first, *[picture for _, picture in frames], *last])

    return change


def elsewhere(frames: Frames, other: Frames, before: int = 6) -> Frames:
    """The recording begins in another aisle, and the camera turns round a corner for some frames."""
    first = [turned(60 + 10 * index)(picture) for index, (_, picture) in enumerate(other[:before])]
    return again(frames, [*first, *[picture for _, picture in frames]])


def paused(pictures: list[Image], count: int) -> list[Image]:
    """The cart goes back for some frames half-way, and on again, with pauses."""
    half = len(pictures) // 2
    back = [*[pictures[half]] * 4, *pictures[half - count : half][::-1], *[pictures[half - count]] * 3]
    return [*pictures[:half], *back, *pictures[half - count :]]


def chained(*changes: Change) -> Change:
    """One change after the other."""

    def change(picture: Image, index: int) -> Image:
        for one in changes:
            picture = one(picture, index)
        return picture

    return change


def camera_cases(poses: Path) -> tuple[ClipCase, ...]:
    """What real cameras give, of a simulated row; nothing of another, whose path is not known."""
    if not poses.is_file():
        return ()
    rig = load_rig(poses)
    operator, cart = painted(rig, 180.0, 25.0, (-75.0, 5.0), 40), below(62.0, blurred=False)
    level = np.zeros((len(rig.world_from_rig), 3))

    def tilted(pitch: float, roll: float, yaw: float = 0.0) -> Change:
        return moved(rig, level, [rig_from_view(yaw, pitch, roll)] * len(level))

    return (
        ClipCase("operator behind the cart", each(chained(operator, cart))),
        ClipCase(
            "operator beside the face", each(painted(rig, -115.0, 25.0, (-75.0, 5.0), 40)), ("seen", "measured", "fit")
        ),
        ClipCase("nadir blurred", each(below(55.0, blurred=True))),
        ClipCase("two lenses, 3 cm apart", each(two_lenses(rig, 0.03)), BENT),
        ClipCase("two lenses, hard seam, 10 % brighter", each(two_lenses(rig, 0.03, 1.1, blend_deg=0.2)), BENT),
        ClipCase("vignettes and fringes", each(two_lenses(rig, 0.0, 1.0, 0.5, 0.003))),
        ClipCase("two lenses, 6 cm apart", each(two_lenses(rig, 0.06, 1.1, 0.4, 0.002)), ANY),
        ClipCase("two lenses, bent at the seam", each(bent_lenses(rig, 0.03, 20.0)), BENT),
        ClipCase("two lenses, bent sharply", each(bent_lenses(rig, 0.03, 5.0)), BENT),
        ClipCase("two lenses, 2 cm, bent at the seam", each(bent_lenses(rig, 0.02, 20.0)), BENT),
        ClipCase("cut by 0.5 %, stretched", of(cropped(0.005)), ("panorama",)),
        ClipCase("dust and finger marks", each(spots)),
        ClipCase("white balance drifts", each(tinted(0.25, 2.0))),
        ClipCase("exposure pumps", each(pumping(0.45, 7.0))),
        ClipCase("bands of LED lamps", each(banded(0.15, 6.0))),
        ClipCase("smoothed, sharpened, contrasty", each(sharpened(1.5, 1.25))),
        ClipCase("motion blur of 4 cm", each(blurred_by_motion(rig, 0.04)), ANY),
        ClipCase("rolling shutter", each(rolling(rig, 0.03, 0.5)), ANY),
        ClipCase("tilted by 3 degrees", each(tilted(3, 1))),
        ClipCase("tilted by 8 degrees", each(tilted(-6, 6))),
        ClipCase("tilted by 15 degrees", each(tilted(12, -10))),
        ClipCase("mounted backwards", each(tilted(0, 0, 180))),
        ClipCase("heading kept", each(stabilised(rig, 0.0))),
        ClipCase("heading drifts by 20 degrees", each(stabilised(rig, 20.0))),
        ClipCase("walked", each(walked(rig, 0.03, 5.0))),
        ClipCase("walked, horizon locked", each(walked(rig, 0.03, 0.0))),
        ClipCase("back for 1 m, with pauses", ordered(lambda p: paused(p, 3)), ("goes back",)),
        ClipCase("5760x2880", each(resized(2880))),
        ClipCase("1440x720", each(resized(720)), ANY),
        ClipCase("carried before and after", carried(9, 9, hand=False), ANY),
        ClipCase("a hand before the lens at both ends", carried(9, 9, hand=True), ANY),
        ClipCase("begins in another aisle", elsewhere, ANY),
        ClipCase(
            "everything at once",
            each(
                chained(
                    two_lenses(rig, 0.03, 1.08, 0.3, 0.001),
                    walked(rig, 0.015, 2.0),
                    operator,
                    cart,
                    spots,
                    tinted(0.1, 2.0),
                    pumping(0.2, 7.0),
                    sharpened(0.8, 1.1),
                )
            ),
            ANY,
        ),
    )
