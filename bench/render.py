"""Rendering a 640x480 view against py360convert's `e2p`: python bench/render.py [--json results.json]

e2p is timed twice: as its own requirements install it (interpolation by SciPy), and with OpenCV beside it, which it
then uses. It keeps its tables between calls as ours does: "first" is a call that has to build them, "next" one that
need not, "clip" the mean over 100 frames, tables included.
"""

import argparse
import json
import time
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import py360convert
import py360convert.utils

from savmap.types import Panorama, ViewSpec
from savmap.vision.views import Renderer

SIZES = (3840, 1024)
SPEC = ViewSpec("bench", 30, 10, hfov_deg=110)


def milliseconds(call: Callable[[], object], times: int) -> float:
    """Least time of a call: what other work on the machine adds is not the call's."""
    taken = []
    for _ in range(times):
        began = time.perf_counter()
        call()
        taken.append(time.perf_counter() - began)
    return 1e3 * min(taken)


def picture(height: int) -> np.ndarray:
    """A textured panorama (height, 2 height, 3)."""
    small = np.random.default_rng(0).integers(0, 255, (height // 8, height // 4, 3), np.uint8)
    return cv2.resize(small, (2 * height, height), interpolation=cv2.INTER_CUBIC)


def ours(image: np.ndarray, antialias: bool) -> dict[str, float]:
    panorama, warm = Panorama(0, 0.0, image), Renderer(antialias)
    warm.render(panorama, SPEC)
    return {
        "first": milliseconds(lambda: Renderer(antialias).render(panorama, SPEC), 9),
        "next": milliseconds(lambda: warm.render(panorama, SPEC), 31),
    }


def theirs(image: np.ndarray, with_opencv: bool) -> dict[str, float]:
    sampler = py360convert.utils.EquirecSampler
    fov = tuple(np.degrees(2 * np.arctan((n - 1) / 2 / SPEC.camera[0, 0])) for n in (SPEC.width, SPEC.height))

    def render() -> None:
        py360convert.e2p(image, fov, SPEC.yaw_deg, SPEC.pitch_deg, (SPEC.height, SPEC.width))

    def render_first() -> None:
        sampler.from_perspective.cache_clear()
        render()

    kept = py360convert.utils.cv2
    py360convert.utils.cv2 = cv2 if with_opencv else None
    try:
        return {"first": milliseconds(render_first, 3), "next": milliseconds(render, 7)}
    finally:
        sampler.from_perspective.cache_clear()
        py360convert.utils.cv2 = kept


def clip_ms(taken: dict[str, float]) -> float:
    """Mean over 100 frames."""
    return (taken["first"] + 99 * taken["next"]) / 100


def compare(height: int) -> list[dict[str, str | float]]:
    """One row a way of rendering, with how many times our default is faster."""
    image = picture(height)
    taken = {
        "savmap": ours(image, True),
        "savmap, no antialiasing": ours(image, False),
        "e2p": theirs(image, False),
        "e2p, OpenCV installed": theirs(image, True),
    }
    base = taken["savmap"]
    return [
        {
            "panorama": f"{2 * height}x{height}",
            "renderer": name,
            "first_ms": each["first"],
            "next_ms": each["next"],
            "clip_ms": clip_ms(each),
            "clip_ratio": clip_ms(each) / clip_ms(base),
            "next_ratio": each["next"] / base["next"],
        }
        for name, each in taken.items()
    ]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--json", type=Path, help="write the figures here")
    target = parser.parse_args().json
    rows = [row for height in SIZES for row in compare(height)]
    print(
        f"{'panorama':12}{'renderer':26}{'first ms':>10}{'next ms':>10}{'clip ms':>10}"
        f"{'ratio next':>12}{'ratio clip':>12}"
    )
    for row in rows:
        print(
            f"{row['panorama']:12}{row['renderer']:26}{row['first_ms']:10.1f}{row['next_ms']:10.2f}"
            f"{row['clip_ms']:10.2f}{row['next_ratio']:12.1f}{row['clip_ratio']:12.1f}"
        )
    if target:
        target.write_text(json.dumps(rows, indent=2) + "\n")


if __name__ == "__main__":
    main()
