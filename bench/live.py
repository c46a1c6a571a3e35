"""What a live session of `savmap live` does on this machine: how far it stays behind, what its assistant says, what memory it takes.

    python -m bench live [--parts advice walk memory] [--site SITE.yaml] [--clips VIDEO ...] [--minutes 60] [--pace 1] [--keep DIR]

- `advice`: footage that deserves a warning is made of each clip, picture by picture, and shown to the assistant: which codes it says, in how many
  frames, and how soon. Of the clean clips it should say nothing.
- `walk`: a site's first row at the pace at which it was filmed: share of the frames that are measured at once, from a frame's coming to its
  measurement, from it to the first map, between maps; whether the map at the end has the bytes of `savmap map`'s.
- `memory`: an hour of footage through `LiveSession`, as fast as it takes it: memory after each five minutes.
"""

import argparse
import os
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import cv2
import numpy as np

from bench.baseline import Figures
from bench.clips import Frames, Image, lit, out_of_focus, read
from bench.cost import memory_mb, processes
from savmap import LiveSession
from savmap.apps.live.assistant import CaptureAssistant
from savmap.apps.live.session import LiveMapping
from savmap.apps.live.sources import frames_of, live_job
from savmap.files.atomic import sha256
from savmap.types import Panorama
from savmap.video.motion import PassWatch

ROOT = Path(__file__).parents[1]
SITE = ROOT / "savmap" / "demo" / "site.yaml"
CLIPS = (ROOT / "savmap" / "demo" / "aisle-dev.mp4",)
HOUR_FPS, HELD, STEP_MIN = 1, 100, 5
HANDS_DEG = {"left": -90.0, "right": 90.0}

Change = Callable[[int, Image], Image]


def five_times(frames: Frames) -> Frames:
    """Five times as fast as it was filmed."""
    return [(index * (frames[1][0] - frames[0][0]), image) for index, (_, image) in enumerate(frames[::5])]


def from_middle(change: Change) -> Callable[[Frames], Frames]:
    """A change of the pictures of the second half."""
    return lambda frames: [
        (stamp, change(index, image) if index >= len(frames) // 2 else image)
        for index, (stamp, image) in enumerate(frames)
    ]


def turned_by(rate_deg_s: float) -> Change:
    """The rig turns to the right at a rate, six frames a second."""
    return lambda index, image: np.roll(image, -round(index * rate_deg_s / 6 / 360 * image.shape[1]), axis=1)


def with_hands(index: int, image: Image) -> Image:
    """Hands in four directions, two of which are before the faces."""
    height, width = image.shape[:2]
    covered = image.copy()
    for bearing in (-135, -45, 45, 135):
        centre = round((bearing + 180) / 360 * width), round(0.47 * height)
        cv2.ellipse(covered, centre, (width // 18, height // 7), 20, 0, 360, (150, 110, 90), -1)
    return covered


def flickering(index: int, image: Image) -> Image:
    """A lamp that two frames see differently."""
    return lit(0.6)(image) if index % 2 else image


FAULTS: Mapping[str, tuple[str, Callable[[Frames], Frames]]] = {
    "clean": ("", lambda frames: frames),
    "five times as fast": ("too-fast", five_times),
    "turning": ("turning", from_middle(turned_by(40.0))),
    "a hand before the face": ("covered", from_middle(with_hands)),
    "out of focus": ("blurred", from_middle(lambda _, image: out_of_focus(out_of_focus(image)))),
    "dark": ("dark", from_middle(lambda _, image: lit(0.08)(image))),
    "flicker": ("flicker", from_middle(flickering)),
}
"""Faults by name: the code that each deserves, and what makes the footage."""


def advice(clips: Sequence[Path]) -> Figures:
    """Of each fault and clip: in how many frames its code was said, after how many from its beginning, and what else was said."""
    figures: dict[str, Mapping[str, float]] = {}
    for clip in clips:
        frames = read(clip)
        way = way_deg(frames)
        for name, (code, change) in FAULTS.items():
            for side, turn in HANDS_DEG.items():
                assistant, said, first = CaptureAssistant(facing_deg=way + turn), Counter[str](), 0
                changed = change(frames)
                begins = len(changed) // 2 if len(changed) == len(frames) and code else 0
                for index, (stamp, image) in enumerate(changed):
                    codes = {item.code for item in assistant.take(Panorama(index, stamp, image))}
                    said.update(codes)
                    first = first or (index - begins + 1 if code in codes else 0)
                others = ", ".join(f"{other} {count}" for other, count in said.items() if other != code)
                row = {"said": said[code], "after frames": first, "other": said.total() - said[code]}
                figures[f"{clip.stem}, {side}, {name}"] = row
                print(f"{clip.stem}, {side}, {name}: {row} {others}", flush=True)
    return figures


def way_deg(frames: Frames) -> float:
    """In which direction the camera goes, degrees to the right of the panorama's centre."""
    watch = PassWatch()
    for index, (stamp, image) in enumerate(frames):
        watch.update(Panorama(index, stamp, image))
    ways = np.radians([motion.way for motion in watch.steps.motions])
    return float(np.degrees(np.angle(np.exp(1j * ways).sum())))


def walk(site: Path, pace: float, folder: Path) -> Figures:
    """A row at its pace, in this process, then as `savmap map` maps it."""
    job = live_job(site, None, folder / "live")
    came: dict[int, float] = {}
    done: dict[int, float] = {}
    maps: list[float] = []
    slowest, begun = 0.0, time.monotonic()
    with LiveMapping(job.walked, job.row) as live:
        for panorama in frames_of(job.clip, None, pace, 10.0):
            came[panorama.frame] = before = time.monotonic()
            state = live.take(panorama)
            slowest = max(slowest, time.monotonic() - before)
            done |= {number: time.monotonic() for number in live.measured if number not in done}
            if state.maps > len(maps):
                maps.append(time.monotonic() - begun)
    footage = state.footage_s
    lags = [done[number] - came[number] for number in done]
    subprocess.run([sys.executable, "-m", "savmap", "live", site, "--pace", "0", "-o", folder / "live"], check=False)
    subprocess.run([sys.executable, "-m", "savmap", "map", site, "-o", folder / "batch"], check=False)
    digests = [sha256(folder / name / "map.json") for name in ("live", "batch")]
    row = {
        "footage s": round(footage, 1),
        "frames": len(came),
        "measured": len(done),
        "lag s, median": round(float(np.median(lags)), 2) if lags else np.nan,
        "lag s, 95 %": round(float(np.percentile(lags, 95)), 2) if lags else np.nan,
        "first map s": round(maps[0], 1) if maps else np.nan,
        "maps": len(maps),
        "longest take s": round(slowest, 2),
        "same bytes": digests[0] == digests[1],
    }
    print(row, flush=True)
    return {f"{site.parent.name}, pace {pace:g}": row}


def memory(clip: Path, minutes: int, folder: Path) -> Figures:
    """Footage of a clip, to and fro, handed to a session as fast as it takes it: memory of this process and of that which maps, MB."""
    images = [
        np.asarray(cv2.resize(image, (1024, 512), interpolation=cv2.INTER_AREA), np.uint8)
        for _, image in read(clip)[:HELD]
    ]
    course = [*images, *images[-2:0:-1]]
    figures: dict[str, Mapping[str, float]] = {}
    with LiveSession(SITE, ["shelves"], output=folder) as session:
        for number in range(60 * minutes * HOUR_FPS):
            state = session.add(number / HOUR_FPS, course[number % len(course)])
            if (number + 1) % (60 * STEP_MIN * HOUR_FPS) == 0:
                walking, *mapping = processes(os.getpid())
                sizes = {"walk MB": memory_mb([walking]), "map MB": memory_mb(mapping)}
                row = {**sizes, "measured": state.measured, "maps": state.maps, "mapped frames": state.mapped_frames}
                figures[f"after {(number + 1) // HOUR_FPS // 60} min"] = row
                print(f"{(number + 1) // HOUR_FPS // 60} min: {row} {state.problem}", flush=True)
    return figures


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of this bench."""
    parser.add_argument("--parts", nargs="+", choices=("advice", "walk", "memory"), default=["advice", "walk"])
    parser.add_argument("--site", type=Path, default=SITE)
    parser.add_argument("--clips", type=Path, nargs="+", default=list(CLIPS))
    parser.add_argument("--minutes", type=int, default=60, help="of footage for `memory`")
    parser.add_argument("--pace", type=float, default=1.0)


def run(given: argparse.Namespace) -> Figures:
    """The figures of the parts that are asked for."""
    folder = given.keep
    steps: Mapping[str, Callable[[], Figures]] = {
        "advice": lambda: advice(given.clips),
        "walk": lambda: walk(given.site, given.pace, folder),
        "memory": lambda: memory(given.clips[0], given.minutes, folder / "hour"),
    }
    return {name: row for part in given.parts for name, row in steps[part]().items()}
