"""What `bench/fuzz.py` does with one broken file, in a process of its own: read it as `savmap map` does, and judge what comes."""

import json
import math
import os
import resource
import sys
import time
import traceback
import warnings
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from itertools import chain
from pathlib import Path

import numpy as np
from broken import index_in, picture

from savmap.errors import VideoError
from savmap.types import Panorama
from savmap.video.clip import Clip, DecodeReport, VideoInfo
from savmap.video.reader import expected_frames, panoramas, preview_frames, probe

ADDRESS_SPACE = 12 * 2**30
MUCH = 6.0
GREY = (0.299, 0.587, 0.114)


@dataclass(frozen=True)
class Reading:
    """How a file ended: `refused` (a clear error), `reported` (frames, and a report of those skipped or missing), `whole`, or
    `failed`. `smeared`: frames used that differ from the picture that was encoded. Times in s, memory in MB."""

    outcome: str
    line: str
    frames: int = 0
    skipped: int = 0
    smeared: int = 0
    noise: str = ""
    seconds: float = 0.0
    peak_mb: float = 0.0


class WrongError(Exception):
    """Frames that break the contract of `panoramas`."""


def require(holds: bool, what: str) -> None:
    if not holds:
        raise WrongError(what)


def walk(path: Path) -> Reading:
    """Probe, previews, all frames to the end, and a part of the clip. Raises WrongError, and whatever savmap lets through."""
    try:
        info = probe(path)
        report = DecodeReport()
        whole = Clip(path, fps=60.0)
        require(expected_frames(whole, info) >= 1, "no frames are expected")
        keys, pairs = preview_frames(Clip(path))
        check_previews([*keys, *chain.from_iterable(pairs)], info)
        count, smeared = count_frames(panoramas(whole, 7, report), info, 7, 0.0, math.inf)
        part(path, info)
    except VideoError as error:
        require("\n" not in str(error) and str(path) in str(error), f"unclear: {error}")
        return Reading("refused", str(error))
    require(report.used == count, f"{count} frames came, {report.used} are reported")
    return Reading("whole" if report.complete else "reported", report.text(), count, report.skipped, smeared)


def part(path: Path, info: VideoInfo) -> None:
    """A time range in the middle; an error there is as good as an error for the whole."""
    start, end = 0.3 * info.duration_s, 0.8 * info.duration_s
    try:
        count_frames(panoramas(Clip(path, start, end, 60.0)), info, 0, start, end)
    except VideoError as error:
        require("\n" not in str(error), f"unclear: {error}")


def check_previews(previews: Iterable[Panorama], info: VideoInfo) -> None:
    for panorama in previews:
        require(
            panorama.image.ndim == 3 and panorama.image.shape[1] == 2 * panorama.image.shape[0],
            f"preview {panorama.image.shape}",
        )
        require(math.isfinite(panorama.stamp_s) and panorama.stamp_s >= 0, f"preview at {panorama.stamp_s} s")


def count_frames(frames: Iterable[Panorama], info: VideoInfo, first: int, start: float, end: float) -> tuple[int, int]:
    """How many panoramas there are, and how many of them are smeared. WrongError: numbers, order, times or shapes."""
    last, count, smeared = -math.inf, 0, 0
    for count, panorama in enumerate(frames, start=1):
        require(panorama.frame == first + count - 1, f"frame {panorama.frame} is number {first + count - 1}")
        require(
            math.isfinite(panorama.stamp_s) and panorama.stamp_s > last, f"{panorama.stamp_s} s comes after {last} s"
        )
        require(start - 1e-5 <= panorama.stamp_s < end, f"{panorama.stamp_s} s is not in {start} to {end} s")
        require(panorama.image.shape == (info.height, info.width, 3), f"{panorama.image.shape} of {info}")
        require(panorama.image.dtype == np.uint8, str(panorama.image.dtype))
        last = panorama.stamp_s
        smeared += is_smeared(panorama)
    return count, smeared


def is_smeared(panorama: Panorama) -> bool:
    """Whether an image is none of those that `picture` gives (mean difference above MUCH grey levels)."""
    height, width = panorama.image.shape[:2]
    if width > 512:
        return False
    wanted = picture(index_in(panorama.image), width, height).astype(int)
    given = panorama.image.astype(int)
    if np.ptp(given, axis=-1).max() < 3:
        given, wanted = given.mean(axis=-1), wanted @ GREY
    return bool(np.abs(given - wanted).mean() > MUCH)


def peak_mb() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (1 if sys.platform == "darwin" else 1024) / 1e6


def child(path: Path, results: Path) -> None:
    """Walk through a file and write `Reading` to `results` as JSON; what is printed meanwhile is kept as `noise`."""
    warnings.simplefilter("error")
    resource.setrlimit(resource.RLIMIT_AS, (ADDRESS_SPACE, ADDRESS_SPACE))
    noise = results.with_suffix(".noise")
    spoken = os.open(noise, os.O_RDWR | os.O_CREAT)
    os.dup2(spoken, 1)
    os.dup2(spoken, 2)
    began = time.monotonic()
    try:
        reading = walk(path)
    except WrongError as error:
        reading = Reading("failed", f"wrong: {error}")
    except BaseException as error:
        reading = Reading("failed", f"{type(error).__name__}: {error} {traceback.format_exc()}")
    sys.stdout.flush()
    sys.stderr.flush()
    said = noise.read_text(errors="replace")[:500]
    content = asdict(reading) | {"noise": said, "seconds": time.monotonic() - began, "peak_mb": peak_mb()}
    results.write_text(json.dumps(content))
