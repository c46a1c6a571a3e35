"""What `savmap map` costs by stage, against decoding the same file to nowhere.

    python -m bench throughput [SITE] [--8k] [--keep DIR] [--rounds 2]

A site's first row is mapped (the demo's footage by default). With `--8k` its footage is scaled to 7680x3840 at 30 frames a second, given a sensor's
noise, and coded as a camera does it (P frames only, a key frame a second, 133 Mbit/s). Encoding takes minutes: `--keep` keeps the file for the
next time. The bound is `ffmpeg -threads 2 -i FILE -f null -`; the two take turns. Other work on the machine makes both slower by the clock;
processor time does not count it.
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
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from bench.baseline import Figures
from savmap.files.atomic import write_text

ROOT = Path(__file__).parents[1]
SITE = ROOT / "examples" / "aisle-dev" / "site.yaml"
FILTERS = "fps=30,scale=7680:3840:flags=bicubic,noise=alls=8:allf=t,format=yuv420p"
RATE_KBIT = 133_000
CODER = f"keyint=30:min-keyint=30:scenecut=0:open-gop=0:bframes=0:vbv-maxrate={RATE_KBIT}:vbv-bufsize={RATE_KBIT}:log-level=error"
DECODE = """
import av, sys
with av.open(sys.argv[1]) as container:
    stream = container.streams.video[0]
    stream.thread_type, stream.codec_context.thread_count = "AUTO", 2
    for frame in container.decode(stream):
        pass
"""
SECONDS: dict[str, float] = defaultdict(float)
WALK = ("render", "segment", "plugins")
Run = dict[str, Any]


def first_row(site: Path) -> Run:
    """The first row of a site file, its reference and plugin bays beside it."""
    content = yaml.safe_load(site.read_text(encoding="utf-8"))
    name = next(iter(content["rows"]))
    return {**content, "rows": {name: content["rows"][name]}}


def source_of(site: Path) -> Path:
    """The first video of a site's first row."""
    row = next(iter(first_row(site)["rows"].values()))
    return Path(site.parent / row["passes"][0]["video"])


def footage(folder: Path, site: Path) -> Path:
    """The 8K file, made where it is not there yet."""
    video = folder / ("8k.mp4" if site == SITE else f"8k-{site.parent.name}.mp4")
    if not video.exists():
        part = folder / "part.mp4"
        coding = ["-c:v", "libx265", "-preset", "ultrafast", "-b:v", f"{RATE_KBIT}k", "-x265-params", CODER]
        source = ["-i", str(source_of(site)), "-vf", FILTERS, *coding, "-tag:v", "hvc1", str(part)]
        subprocess.run(["ffmpeg", "-v", "error", "-y", *source], check=True, stdin=subprocess.DEVNULL)
        part.rename(video)
    return video


def write_site(source: Path, video: Path, path: Path) -> None:
    """A site file of the first row, filmed in a video, with the references of the source."""
    site = first_row(source)
    (row,) = site["rows"].values()
    row["passes"] = [{"video": str(video.resolve()), "side": row["passes"][0].get("side", "left")}]
    site.pop("survey", None)
    path.write_text(yaml.safe_dump(site), encoding="utf-8")


def measured(command: Sequence[object]) -> Run:
    """Seconds of a command, by the clock and of the processor."""
    before, begin = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    subprocess.run([str(part) for part in command], check=True, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    processor = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return {"clock s": time.perf_counter() - begin, "processor s": processor}


def timed(owner: Any, name: str, stage: str, clock: Callable[[], float]) -> None:
    """Add what a clock shows for every call of owner.name to a stage; calls while views are aimed belong to the aim."""
    inner: Callable[..., Any] = getattr(owner, name)

    def outer(*arguments: Any, **named: Any) -> Any:
        if "aiming" in SECONDS:
            return inner(*arguments, **named)
        if stage == "aim":
            SECONDS["aiming"] = 1.0
        begin = clock()
        try:
            return inner(*arguments, **named)
        finally:
            SECONDS[stage] += clock() - begin
            if stage == "aim":
                del SECONDS["aiming"]

    setattr(owner, name, outer)


def decoding(video: Path) -> list[object]:
    """The command that decodes a file to nowhere: FFmpeg's, or PyAV without conversion where that is not installed."""
    if shutil.which("ffmpeg"):
        return ["ffmpeg", "-v", "error", "-threads", "2", "-i", video, "-f", "null", "-"]
    return [sys.executable, "-c", DECODE, video]


def map_here(site: Path, target: Path) -> None:
    """Map a site in this process and write what each stage took."""
    import savmap
    from savmap.jobs import tasks
    from savmap.pipeline import measure
    from savmap.plugin.segmenters import CachedSegmenter
    from savmap.vision.views import Renderer

    timed(measure, "with_best_networks", "aim", time.process_time)
    timed(measure, "plan_pass", "aim", time.process_time)
    timed(measure.RowWalk, "over", "walk", time.process_time)
    timed(Renderer, "render", "render", time.thread_time)
    timed(CachedSegmenter, "predict", "segment", time.thread_time)
    timed(measure.RowWalk, "_extract", "plugins", time.thread_time)
    timed(tasks, "map_rows", "solve", time.process_time)
    with tempfile.TemporaryDirectory() as folder:
        rows = savmap.map_site(site, ["shelves", "lights"], output=folder).rows.values()
    stages = {"decode": SECONDS["walk"] - sum(SECONDS[stage] for stage in WALK)}
    stages |= {stage: SECONDS[stage] for stage in (*WALK, "aim", "solve")}
    unit = 1 if sys.platform == "darwin" else 1024
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit / 1e6
    stages["start, check, write"] = time.process_time() - sum(stages.values())
    write_text(target, json.dumps({"stages": stages, "peak_mb": peak, "frames": sum(len(row.frames) for row in rows)}))


def compared(source: Path, video: Path, rounds: int) -> Figures:
    """Both ways, in turn: means over all rounds."""
    ours, bound = list[Run](), list[Run]()
    with tempfile.TemporaryDirectory() as folder:
        site, target = Path(folder) / "site.yaml", Path(folder) / "run.json"
        write_site(source, video, site)
        for _ in range(rounds):
            bound.append(measured(decoding(video)))
            taken = measured([sys.executable, "-m", "bench.throughput", site, target])
            ours.append({**taken, **json.loads(target.read_text())})

    def mean(runs: Sequence[Run], key: str) -> float:
        return float(np.mean([run[key] for run in runs]))

    columns = ("processor s", "clock s")
    table = {stage: {"processor s": mean([run["stages"] for run in ours], stage)} for stage in ours[0]["stages"]}
    ways = {"savmap map": ours, "decoding alone": bound}
    table |= {name: {column: mean(runs, column) for column in columns} for name, runs in ways.items()}
    frames = ours[0]["frames"]
    table = {name: {**cells, "ms a frame": 1e3 * cells["processor s"] / frames} for name, cells in table.items()}
    table["ratio"] = {column: mean(ours, column) / mean(bound, column) for column in columns}
    return {**table, "peak memory": {"MB": max(run["peak_mb"] for run in ours)}}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of this bench."""
    parser.add_argument("site", nargs="?", type=Path, default=SITE, help="its first row is taken")
    parser.add_argument(
        "--8k", dest="large", action="store_true", help="scale and code the footage as a camera's 8K file"
    )
    parser.add_argument("--keep", type=Path, help="folder for the generated files")
    parser.add_argument("--rounds", type=int, default=2)


def run(given: argparse.Namespace) -> Figures:
    """Processor and clock time of stages, of the whole and of decoding alone."""
    with tempfile.TemporaryDirectory() as folder:
        keep = (given.keep or Path(folder)).absolute()
        keep.mkdir(parents=True, exist_ok=True)
        source = given.site.absolute()
        return compared(source, footage(keep, source) if given.large else source_of(source), given.rounds)


if __name__ == "__main__":
    map_here(Path(sys.argv[1]), Path(sys.argv[2]))
