"""What `savmap map` costs, beside decoding the same file to nowhere, on an idle machine.

    python -m bench cost [SITE] [--8k] [--faces SITE] [--keep DIR] [--rounds 5]

Medians over all rounds, in which all take turns: a site's first row (the demo's by default); with `--faces` a site of two rows that share a drive,
against its first row alone; and the solve of a row of the paper's size, from constraints to covariances and checks. `--8k` scales the footage to
7680x3840 at 30 frames a second, gives it a sensor's noise and codes it as a camera does (P frames only, a key frame a second, 133 Mbit/s); that
takes minutes: `--keep` keeps the file for the next time. The bound is `ffmpeg -threads 2 -i FILE -f null -`.

A stage is the package that a thread was in, which is asked a hundred times a second; threads without Python (of the decoder and the networks) are
`native threads`; `py-spy record` draws more of it. Memory is that of all processes together.
"""

import argparse
import json
import os
import resource
import shutil
import subprocess
import sys
import tempfile
import threading
import time
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np
import yaml

from bench.baseline import Figures
from savmap.files.atomic import write_text

ROOT = Path(__file__).parents[1]
SITE = ROOT / "savmap" / "demo" / "site.yaml"
PLUGINS = ("shelves", "lights")
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
EVERY_S = 0.01
Run = dict[str, Any]


class Sampler(threading.Thread):
    """Adds up the processor time, s, of every Python thread by the stage that it is found in."""

    def __init__(self) -> None:
        super().__init__(daemon=True)
        self.stages = defaultdict[str, float](float)
        self._used = dict[int, float]()

    def run(self) -> None:
        while True:
            time.sleep(EVERY_S)
            for thread, frame in sys._current_frames().items():
                try:
                    used = time.clock_gettime(time.pthread_getcpuclockid(thread))
                except OSError:  # it has ended
                    continue
                if thread != self.ident:
                    self.stages[stage_of(frame)] += used - self._used.get(thread, 0.0)
                self._used[thread] = used


def stage_of(frame: FrameType | None) -> str:
    """The package of the innermost function of savmap or a plugin."""
    while frame is not None:
        package, *inner = str(frame.f_globals.get("__name__", "?")).split(".")
        if package == "savmap":
            return ".".join([package, *inner[: 2 if inner[:1] == ["vision"] else 1]])
        if package.startswith("savmap_"):
            return package
        frame = frame.f_back
    return "other"


def map_here(site: Path, target: Path) -> None:
    """Map a site in this process and write where its processor time went."""
    sampler = Sampler()
    sampler.start()
    import savmap

    with tempfile.TemporaryDirectory() as folder:
        savmap.map_site(site, PLUGINS, output=folder)
    stages = dict(sampler.stages)
    stages["native threads"] = max(time.process_time() - sum(stages.values()), 0.0)
    write_text(target, json.dumps(stages))


def processes(root: int) -> Iterator[int]:
    """A process and all that it started, by their numbers, where the system tells."""
    yield root
    for file in Path(f"/proc/{root}/task").glob("*/children"):
        try:
            children = file.read_text().split()
        except OSError:  # it has ended
            continue
        for child in children:
            yield from processes(int(child))


def memory_mb(running: Iterable[int]) -> float:
    """The resident memory of processes."""
    total = 0
    for process in running:
        try:
            total += int(Path(f"/proc/{process}/statm").read_text().split()[1])
        except (OSError, IndexError):  # it has ended
            continue
    return total * os.sysconf("SC_PAGE_SIZE") / 1e6


def measured(command: Sequence[object]) -> Run:
    """Seconds of a command, by the clock and of the processor, and the largest memory of all its processes, MB."""
    before, begin, peak = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter(), 0.0
    nowhere = subprocess.DEVNULL
    with subprocess.Popen([str(part) for part in command], stdin=nowhere, stdout=nowhere, cwd=ROOT) as process:
        while process.poll() is None:
            peak = max(peak, memory_mb(processes(process.pid)))
            time.sleep(5 * EVERY_S)
    clock = time.perf_counter() - begin
    if process.returncode:
        raise subprocess.CalledProcessError(process.returncode, process.args)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    processor = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return {"clock s": clock, "processor s": processor, "peak MB": peak}


def mapping(site: Path, folder: Path) -> Run:
    """The cost of mapping a site, with its `stages`."""
    target = folder / "run.json"
    taken = measured([sys.executable, "-m", "bench.cost", site, target])
    return {**taken, "stages": json.loads(target.read_text())}


def decoding(video: Path) -> list[object]:
    """The command that decodes a file to nowhere: FFmpeg's, or PyAV without conversion where that is not installed."""
    if shutil.which("ffmpeg"):
        return ["ffmpeg", "-v", "error", "-threads", "2", "-i", video, "-f", "null", "-"]
    return [sys.executable, "-c", DECODE, video]


def rows_of(source: Path, path: Path, count: int, video: Path | None = None) -> Path:
    """A site file of the first rows of a site, filmed in another video where one is given."""
    site = yaml.safe_load(source.read_text(encoding="utf-8"))
    site["rows"] = dict(list(site["rows"].items())[:count])
    for one in [part for row in site["rows"].values() for part in row["passes"]]:
        one["video"] = str(video or source.parent / one["video"])
    if "survey" in site:
        site["survey"] = str(source.parent / site["survey"])
    path.write_text(yaml.safe_dump(site), encoding="utf-8")
    return path


def source_of(site: Path) -> Path:
    """The first video of a site's first row."""
    row = next(iter(yaml.safe_load(site.read_text(encoding="utf-8"))["rows"].values()))
    return Path(site.parent / row["passes"][0]["video"])


def large(folder: Path, site: Path) -> Path:
    """The 8K file, made where it is not there yet."""
    video = folder / ("8k.mp4" if site == SITE else f"8k-{site.parent.name}.mp4")
    if not video.exists():
        part = folder / "part.mp4"
        coding = ["-c:v", "libx265", "-preset", "ultrafast", "-b:v", f"{RATE_KBIT}k", "-x265-params", CODER]
        source = ["-i", str(source_of(site)), "-vf", FILTERS, *coding, "-tag:v", "hvc1", str(part)]
        subprocess.run(["ffmpeg", "-v", "error", "-y", *source], check=True, stdin=subprocess.DEVNULL)
        part.rename(video)
    return video


def solving(target: Path, rounds: int) -> None:
    """Write the seconds that a row of the paper's size takes to solve, each time."""
    from threadpoolctl import threadpool_limits

    from bench.observed_rows import ESTIMATED, LOWEST_SIGMA_M, driven_row, given, start_of, tracked
    from bench.seeds import seeds
    from savmap.graph import camera_priors, merge, solve_rows
    from savmap.lab.sim.observations import PAPER
    from savmap_shelves.constraints import GridSettings, constrain

    (seed,) = seeds("observation", "dev", 1)
    driven = driven_row(seed, PAPER)
    facts, known = driven.measurements.facts, given(driven, np.random.default_rng([seed, 7]))
    first = start_of(driven, known)
    settings = GridSettings(known.lowest_m, LOWEST_SIGMA_M, bias=ESTIMATED)
    problem = merge(
        camera_priors(facts, first, known.references), constrain(tracked(driven), facts, first, settings=settings)
    )
    taken = []
    with threadpool_limits(1):
        for _ in range(rounds):
            clock, processor = time.perf_counter(), time.process_time()
            solve_rows([problem], [range(len(facts.frames))])
            taken.append({"clock s": time.perf_counter() - clock, "processor s": time.process_time() - processor})
    write_text(target, json.dumps(taken))


def median(runs: Sequence[Run], key: str) -> float:
    """The median of a figure."""
    return float(np.median([run[key] for run in runs]))


def table(runs: Mapping[str, Sequence[Run]]) -> Figures:
    """The figures of all runs, by what ran."""
    stages = defaultdict[str, list[float]](list)
    for run in runs["savmap map"]:
        for stage, seconds in run["stages"].items():
            stages[stage].append(seconds)
    count = len(runs["savmap map"])
    usual = {stage: float(np.median(some + [0.0] * (count - len(some)))) for stage, some in stages.items()}
    figures = {stage: {"processor s": seconds} for stage, seconds in sorted(usual.items(), key=lambda item: -item[1])}
    figures |= {
        name: {key: median(some, key) for key in some[0] if key != "stages"} for name, some in runs.items() if some
    }
    for name, over, under in (
        ("both faces, times one", "both faces", "one face"),
        ("times decoding", "savmap map", "decoding alone"),
    ):
        if runs[over]:
            figures[name] = {
                key: median(runs[over], key) / median(runs[under], key) for key in ("clock s", "processor s")
            }
    return figures


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of this bench."""
    parser.add_argument("site", nargs="?", type=Path, default=SITE, help="its first row is taken")
    parser.add_argument(
        "--8k", dest="large", action="store_true", help="scale and code the footage as a camera's 8K file"
    )
    parser.add_argument("--faces", type=Path, help="a site of two rows that share a drive")
    parser.add_argument("--rounds", type=int, default=5)


def run(given: argparse.Namespace) -> Figures:
    """Processor and clock time of stages, of the whole and of decoding alone, of both faces and of a solve."""
    runs: dict[str, list[Run]] = {
        name: [] for name in ("one face", "both faces", "solve of a paper-size row", "savmap map", "decoding alone")
    }
    with tempfile.TemporaryDirectory() as name:
        folder, source = Path(name), given.site.absolute()
        video = large(given.keep.absolute(), source) if given.large else source_of(source)
        site = rows_of(source, folder / "site.yaml", 1, video)
        faces = {
            name: rows_of(given.faces.absolute(), folder / f"{count}.yaml", count)
            for count, name in enumerate(("one face", "both faces") if given.faces else (), 1)
        }
        for _ in range(given.rounds):
            runs["decoding alone"].append(measured(decoding(video)))
            runs["savmap map"].append(mapping(site, folder))
            for face, path in faces.items():
                runs[face].append(mapping(path, folder))
        subprocess.run(
            [sys.executable, "-m", "bench.cost", folder / "solve.json", str(given.rounds)], check=True, cwd=ROOT
        )
        runs["solve of a paper-size row"] = json.loads((folder / "solve.json").read_text())
    return table(runs)


if __name__ == "__main__":
    if sys.argv[2].isdigit():
        solving(Path(sys.argv[1]), int(sys.argv[2]))
    else:
        map_here(Path(sys.argv[1]), Path(sys.argv[2]))
