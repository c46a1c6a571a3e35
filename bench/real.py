"""Are real racks mapped from a phone's walk: equal bays, every post and beam, at what cost?

    python -m bench real CLIP... [--hfov DEG...] [--length M] [--peer] [--keep DIR]

Each clip is mapped by `savmap map CLIP --camera pinhole`, with a field of view where one is given, and one length,
between the left edges of uprights 2 and 3, where that is given: without it one bay is 1. No truth is known of such a
rack but that its bays are equal: spread % is that of the pitches, by the posts' middle lines; of a post at an end that is
much wider than most, two side by side, the inner edge counts. inner %: without the bays at the ends. path s: of a
processor, to follow points and find the path; all s: of the whole run; decode s: of reading the file.

`--peer`: pycolmap's path (SIFT, sequential matching, every second picture, camera SIMPLE_RADIAL that begins at the same
field of view), its seconds, and how far its places are from savmap's after rotation, translation and scale, as a share
of the way. Each works with one thread.
"""

import argparse
import json
import resource
import subprocess
import sys
import time
from collections.abc import Mapping
from itertools import islice
from pathlib import Path

import numpy as np
import yaml

from bench.baseline import Figures
from bench.odometry import Walk, alone, pycolmaps, score
from savmap.geometry.cameras import Pinhole
from savmap.pipeline.lens_walks import LensWalk, lens_walk
from savmap.site.model import Pass
from savmap.site.sections import USUAL_HFOV_DEG, CameraSection
from savmap.types import Planes
from savmap.video.reader import pictures

WIDER = 1.25
"""Than the usual post: two of them side by side."""
EVERY, OVERLAP = 2, 5
"""Of the peer: pictures, and how many it matches each with."""


def clip_of(video: Path, hfov: float | None) -> Pass:
    """The pass of a clip."""
    return Pass(video=video, camera=CameraSection(model="pinhole", hfov_deg=hfov), fps=60.0)


def of_map(file: Path) -> dict[str, float]:
    """Figures of a map of one row."""
    (row,) = json.loads(file.read_text(encoding="utf-8"))["rows"].values()
    elements = {
        part["id"]: np.array([v["position_m"] for v in part["vertices"]]) for part in row["structures"]["shelves"]
    }
    posts = [points[:, 0] for name, points in elements.items() if name.startswith("upright")]
    left, right = np.sort(np.array([[x.min(), x.max()] for x in posts]), axis=0).T
    usual = float(np.median(right - left))
    middle = (left + right) / 2
    if right[0] - left[0] > WIDER * usual:
        middle[0] = right[0] - usual / 2
    if right[-1] - left[-1] > WIDER * usual:
        middle[-1] = left[-1] + usual / 2
    pitches = np.diff(middle)
    return {
        "posts": len(posts),
        "beams": len(elements) - len(posts),
        "spread %": 100 * float(pitches.std() / pitches.mean()),
        "inner %": 100 * float(pitches[1:-1].std() / pitches[1:-1].mean()),
    }


def mapped(video: Path, hfov: float | None, length_m: float | None, folder: Path) -> dict[str, float]:
    """Figures of a clip's map, and the processor's seconds of all processes that made it."""
    site = {
        "plugins": {"shelves": {}},
        "camera": {"model": "pinhole", **({"hfov_deg": hfov} if hfov else {})},
        "rows": {"A": {"passes": [{"video": str(video.absolute())}]}},
    }
    if length_m:
        between = ["upright 2 / left", "upright 3 / left"]
        site["references"] = {"lengths": [{"between": between, "value": length_m, "sigma": 0.003}]}
    (folder / "site.yaml").write_text(yaml.safe_dump(site), encoding="utf-8")
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    command = [sys.executable, "-m", "savmap", "map", "site.yaml", "--output", "out", "--fresh"]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    seconds = after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime
    print(
        video.name,
        *(line for line in done.stderr.splitlines() + done.stdout.splitlines() if "wrote" not in line),
        sep="\n  ",
    )
    if not (folder / "out" / "map.json").is_file():
        return {"refused": 1, "all s": seconds}
    return {**of_map(folder / "out" / "map.json"), "refused": 0, "all s": seconds}


def walked(video: Path, hfov: float | None) -> tuple[LensWalk, float]:
    """A clip's walk, and a processor's seconds."""
    begun = time.process_time()
    walk = lens_walk(clip_of(video, hfov))
    assert walk is not None
    return walk, time.process_time() - begun


def decoded(video: Path, _: float | None) -> float:
    """A processor's seconds to read a clip."""
    begun = time.process_time()
    for _picture in pictures(clip_of(video, None).clip):
        pass
    return time.process_time() - begun


def peers(video: Path, hfov: float | None) -> Walk:
    """The path of pycolmap."""
    every = islice(enumerate(pictures(clip_of(video, hfov).clip)), 0, None, EVERY)
    numbered = ((number, taken.rgb if isinstance(taken, Planes) else taken) for number, (_, taken) in every)
    return pycolmaps(numbered, lambda width, height: ("SIMPLE_RADIAL", lens_of(width, height, hfov)), OVERLAP)


def lens_of(width: int, height: int, hfov: float | None) -> str:
    """Focal length, principal point and no distortion, as pycolmap takes them."""
    lens = Pinhole.of_hfov(width, height, hfov or USUAL_HFOV_DEG["pinhole"])
    return f"{lens.focal_px[0]}, {width / 2}, {height / 2}, 0"


def of_clip(video: Path, hfov: float | None, given: argparse.Namespace, folder: Path) -> Mapping[str, float]:
    """The figures of a clip."""
    folder.mkdir(parents=True, exist_ok=True)
    walk, path_s = alone(walked, video, hfov)
    figures = {
        **mapped(video, hfov, given.length, folder),
        "field deg": walk.camera.hfov_deg,
        "off px": walk.off_px,
        "lost": int((walk.part > 0).sum()),
        "path s": path_s,
        "decode s": alone(decoded, video, None),
    }
    if given.peer:
        peer = alone(peers, video, hfov)
        here = walk.part == 0
        beside = score(Walk(walk.frames[here], walk.world_from_rig[here, :3, 3]), peer)
        figures |= {"peer s": peer.seconds * (len(peer.frames) + peer.lost), "off peer %": beside["rms %"]}
    return figures


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of this bench."""
    parser.add_argument("clips", type=Path, nargs="+", help="videos of walks along racks")
    parser.add_argument("--hfov", type=float, nargs="+", help="the lens's field of view, degrees; one, or one a clip")
    parser.add_argument("--length", type=float, help="from the left edge of upright 2 to that of upright 3, m")
    parser.add_argument("--peer", action="store_true", help="also pycolmap's path (extra `validators`)")


def run(given: argparse.Namespace) -> Figures:
    """Figures of the clips."""
    fields = given.hfov or [None]
    fields = fields if len(fields) == len(given.clips) else len(given.clips) * fields[:1]
    base = given.keep
    return {
        video.stem: of_clip(video, hfov, given, base / video.stem)
        for video, hfov in zip(given.clips, fields, strict=True)
    }
