"""Ways in which a row's clip can be wrong, or harmlessly different, and what is to come of each: cases for `physics_footage.py`."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from physics_pictures import (
    cropped,
    eyes,
    lit,
    ordinary,
    out_of_focus,
    patched,
    seamed,
    smeared_lens,
    turned,
    two_fisheyes,
)
from physics_videos import Frames, Image


@dataclass(frozen=True)
class Case:
    """A way to change a row's clip. `words`: a pattern of the true reason, where it is to be caught; "" where the map is to be trusted.
    `either`: it may also be trusted, if it is right. `side`, `part`: the
    hand and the part of the clip (shares) that the site file says. `new_way`: the rig goes in another direction of its panorama."""

    name: str
    change: Callable[[Frames, Frames], Frames]
    words: str = ""
    either: bool = False
    side: Callable[[str], str] = field(default=lambda side: side)
    part: tuple[float, float] | None = None
    new_way: bool = False
    container: Mapping[str, Any] = field(default_factory=dict)


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


BACK = "goes back the way it came"
CASES = (
    Case("as it is", of(lambda picture: picture)),
    Case("turned by 70 degrees", of(turned(70)), new_way=True),
    Case("pitched by 15 degrees", of(turned(0, 15, 5)), new_way=True),
    Case(
        "upside down",
        of(turned(0, 0, 180)),
        "upside down|no building|no structure|tilted|contradict|bays were found",
        True,
        new_way=True,
    ),
    Case("reversed", ordered(lambda p: p[::-1]), side=other_hand),
    Case(
        "reversed, side as it was",
        ordered(lambda p: p[::-1]),
        "contradict|not on the|side|heights|bays were found|reference|rest says",
    ),
    Case(
        "mirrored",
        of(lambda p: p[:, ::-1]),
        "contradict|heights|bays were found|reference|rest says|residual",
        new_way=True,
    ),
    Case("there and back", ordered(lambda p: [*p, *p[::-1]]), BACK),
    Case("there and a third back", ordered(lambda p: [*p, *p[::-1][: len(p) // 3]]), BACK),
    Case("there, round and back", ordered(u_turn), f"{BACK}|turned away"),
    Case(
        "hesitates",
        ordered(lambda p: [*p[: len(p) // 2], *p[len(p) // 2 - 6 : len(p) // 2][::-1], *p[len(p) // 2 - 6 :]]),
        BACK,
        True,
    ),
    Case(
        "turns away at the end",
        ordered(lambda p: [*p, *[turned(a)(p[-1]) for a in range(15, 106, 15)]]),
        "turned away",
        True,
    ),
    Case("stands for ten frames", ordered(lambda p: [*p[: len(p) // 2], *[p[len(p) // 2]] * 10, *p[len(p) // 2 :]])),
    Case(
        "stands most of the time",
        ordered(lambda p: [*p[: len(p) // 2], *[p[len(p) // 2]] * 2 * len(p), *p[len(p) // 2 :]]),
        "stands for",
        True,
    ),
    Case("every frame twice", ordered(lambda p: [one for one in p for _ in (0, 1)])),
    Case("gap, times kept", lambda frames, _: without(frames, True), "frames are missing"),
    Case("gap, times rewritten", lambda frames, _: without(frames, False), "frames are missing"),
    Case(
        "three frames missing",
        ordered(lambda p: [*p[: len(p) // 2], *p[len(p) // 2 + 3 :]]),
        "frames are missing",
        True,
    ),
    Case(
        "cut to another row",
        lambda frames, other: again(frames, [p for _, p in [*frames[: len(frames) // 2], *other[5:25]]]),
        "a cut|after a cut",
    ),
    Case("cut, camera turned round", from_middle(turned(180)), "a cut|after a cut"),
    Case("turned by 90 degrees half-way", from_middle(turned(90)), "a cut|after a cut|turned away"),
    Case("turned by 20 degrees half-way", from_middle(turned(20)), "a cut|after a cut|turned away", True),
    Case(
        "cropped and stretched",
        of(cropped(0.08)),
        "whole equirectangular|whole panorama|no panorama|contradict|rest says|fit",
    ),
    Case("smear on a lens, left", of(smeared_lens(-90, 50, 8.0)), "seen|measured|fit|support|part|bays", True),
    Case("smear on a lens, right", of(smeared_lens(90, 50, 8.0)), "seen|measured|fit|support|part|bays", True),
    Case("out of focus", of(out_of_focus), "seen|measured|fit|part|bays", True),
    Case("one smeared frame", ordered(smeared)),
    Case("step of exposure", from_middle(lit(1.6))),
    Case("dark", of(lit(0.3, 3.0))),
    Case("tripod and logo", of(patched)),
    Case("lenses exposed differently", of(seamed)),
    Case("the first half only", of(lambda p: p), "part|heights|bays|seen|no such thing was found", part=(0.0, 0.5)),
    Case("VR180 side by side", of(eyes(np.pi, False)), "side by side"),
    Case("stereo side by side", of(eyes(2 * np.pi, False)), "side by side"),
    Case("stereo above one another", of(eyes(2 * np.pi, True)), "one eye above"),
    Case("two fisheyes", of(two_fisheyes), "fisheye"),
    Case("ordinary video", of(ordinary), "no panorama"),
    Case("flag: turn by 180 degrees", of(lambda p: p), "to be turned", container={"degrees": 180}),
    Case("two streams", of(lambda p: p), "2 video streams", container={"streams": 2}),
)
