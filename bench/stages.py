"""Seconds and memory of each stage of one `savmap map`, and the whole against decoding the same file to nowhere.

    python bench/stages.py [site.yaml] [-o bench/results/stages.json]

The bound is `ffmpeg -threads 2 -i FILE -f null -` where ffmpeg is installed, else decoding with PyAV without conversion.
"""

import argparse
import json
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable
from pathlib import Path
from typing import Any

import av

import savmap
from savmap.files.atomic import write_text
from savmap.jobs import map_site
from savmap.pipeline import measure, row
from savmap.plugin.manager import LoadedPlugin
from savmap.plugin.segmenters import CachedSegmenter
from savmap.site.load import load_site
from savmap.vision.views import Renderer

ROOT = Path(__file__).parent.parent
SECONDS: dict[str, float] = defaultdict(float)
PEAK_MB: dict[str, float] = {}
PANORAMAS = "panoramas"


def peak_mb() -> float:
    """Peak resident memory of this process so far, MB."""
    unit = 1 if sys.platform == "darwin" else 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit / 1e6


def timed(owner: Any, name: str, stage: str) -> None:
    """Add the time of every call of owner.name to a stage."""
    inner: Callable[..., Any] = getattr(owner, name)

    def outer(*args: Any, **kwargs: Any) -> Any:
        start = time.perf_counter()
        try:
            return inner(*args, **kwargs)
        finally:
            SECONDS[stage] += time.perf_counter() - start
            PEAK_MB[stage] = peak_mb()

    setattr(owner, name, outer)


def timed_frames() -> None:
    """Add the time spent waiting for decoded frames to a stage."""
    inner: Callable[..., Any] = getattr(measure, PANORAMAS)

    def outer(*args: Any, **kwargs: Any) -> Any:
        frames = inner(*args, **kwargs)
        while True:
            start = time.perf_counter()
            frame = next(frames, None)
            SECONDS["decode, convert"] += time.perf_counter() - start
            PEAK_MB["decode, convert"] = peak_mb()
            if frame is None:
                return
            yield frame

    setattr(measure, PANORAMAS, outer)


def bound(video: Path) -> tuple[str, float]:
    """What decodes the file to nowhere, and in how many seconds."""
    start = time.perf_counter()
    if shutil.which("ffmpeg"):
        command = ["ffmpeg", "-v", "error", "-threads", "2", "-i", str(video), "-f", "null", "-"]
        subprocess.run(command, check=True, stdin=subprocess.DEVNULL)
        return "ffmpeg -threads 2 -f null -", time.perf_counter() - start
    with av.open(str(video)) as container:
        stream = container.streams.video[0]
        stream.thread_type, stream.codec_context.thread_count = "AUTO", 2
        for _ in container.decode(stream):
            pass
    return "PyAV, 2 threads, no conversion", time.perf_counter() - start


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("site", nargs="?", type=Path, default=ROOT / "examples" / "aisle-dev" / "site.yaml")
    parser.add_argument("-o", "--output", type=Path, default=ROOT / "bench" / "results" / "stages.json")
    arguments = parser.parse_args()
    timed_frames()
    timed(measure, "with_best_networks", "aim")
    timed(measure, "plan_pass", "aim")
    timed(Renderer, "render", "render (with the aim's)")
    timed(CachedSegmenter, "predict", "segment (with the aim's)")
    timed(LoadedPlugin, "extract_features", "extract (with the aim's)")
    timed(LoadedPlugin, "track", "track")
    timed(LoadedPlugin, "constrain", "constrain")
    timed(row, "solve", "solve")
    timed(map_site, "_write_results", "write")
    with tempfile.TemporaryDirectory() as folder:
        start = time.perf_counter()
        savmap.map_site(arguments.site, output=folder)
        whole = time.perf_counter() - start
    videos = {row_pass.video for row in load_site(arguments.site).rows.values() for row_pass in row.passes}
    names, seconds = zip(*(bound(video) for video in videos), strict=True)
    SECONDS["whole"], PEAK_MB["whole"] = whole, peak_mb()
    result = {
        "stages": {stage: {"seconds": SECONDS[stage], "peak_mb": PEAK_MB[stage]} for stage in SECONDS},
        "bound": {"what": names[0], "seconds": sum(seconds)},
        "ratio": whole / sum(seconds),
    }
    for stage in SECONDS:
        print(f"{stage:26s} {SECONDS[stage]:8.2f} s   peak so far {PEAK_MB[stage]:7.0f} MB")
    print(f"{names[0]:26s} {sum(seconds):8.2f} s   whole / bound = {result['ratio']:.1f}")
    write_text(arguments.output, json.dumps(result, indent=2) + "\n")


if __name__ == "__main__":
    main()
