"""One `savmap map` of 8K HEVC against decoding the same file to nowhere, by stage, and its memory at several times the length.

    python bench/throughput.py [--source SITE] [--keep DIR] [--rounds 2] [--lengths 1,4] [--jobs N] [-o bench/results/throughput.json]

The footage of a site (its first row's; examples/aisle-dev, or what `savmap simulate` wrote) is scaled to 7680x3840 at 30 frames a second, given a sensor's noise, and coded as a camera does it
(P frames only, a key frame a second, 133 Mbit/s); it is mapped at 15 frames a second with two views of 640x480. Encoding takes
minutes: `--keep` keeps the file for the next time. Longer files are the same one several times over; each part is mapped as a
row: one after another in this process, with a table of stages, or with `--jobs` in so many processes. The bound is `ffmpeg -threads 2 -i FILE -f null -`; the two take turns. Other work on the machine makes both slower by the clock;
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
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import yaml

from savmap.files.atomic import write_text

ROOT = Path(__file__).parent.parent
SITE = ROOT / "examples" / "aisle-dev" / "site.yaml"
FILTERS = "fps=30,scale=7680:3840:flags=bicubic,noise=alls=8:allf=t,format=yuv420p"
RATE_KBIT = 133_000
CODER = f"keyint=30:min-keyint=30:scenecut=0:open-gop=0:bframes=0:vbv-maxrate={RATE_KBIT}:vbv-bufsize={RATE_KBIT}:log-level=error"
SECONDS: dict[str, float] = defaultdict(float)
WALK = ("render", "segment", "plugins")
Run = dict[str, Any]


def ffmpeg(*arguments: object) -> None:
    """Run ffmpeg, quietly; it is for the bench alone."""
    if shutil.which("ffmpeg") is None:
        raise SystemExit("ffmpeg is not installed here; it makes the footage and is the bound")
    subprocess.run(["ffmpeg", "-v", "error", *map(str, arguments)], check=True, stdin=subprocess.DEVNULL)


def first_row(site: Path) -> Run:
    """The first row of a site file, its reference and plugin bays beside it."""
    content = yaml.safe_load(site.read_text(encoding="utf-8"))
    name = next(iter(content["rows"]))
    return {**content, "rows": {name: content["rows"][name]}}


def footage(folder: Path, site: Path) -> Path:
    """The 8K file, made where it is not there yet."""
    video = folder / ("8k.mp4" if site == SITE else f"8k-{site.parent.name}.mp4")
    if not video.exists():
        part = folder / "part.mp4"
        row = next(iter(first_row(site)["rows"].values()))
        source = site.parent / row["passes"][0]["video"]
        coding = ["-c:v", "libx265", "-preset", "ultrafast", "-b:v", f"{RATE_KBIT}k", "-x265-params", CODER]
        ffmpeg("-y", "-i", source, "-vf", FILTERS, *coding, "-tag:v", "hvc1", part)
        part.rename(video)
    return video


def repeated(video: Path, times: int) -> Path:
    """The file so many times over."""
    longer = video.with_name(f"{video.stem}-{times}.mp4")
    if times > 1 and not longer.exists():
        listed = video.with_name("parts.txt")
        listed.write_text(f"file '{video.resolve()}'\n" * times, encoding="utf-8")
        part = longer.with_name(f"part-{times}.mp4")
        ffmpeg("-y", "-f", "concat", "-safe", "0", "-i", listed, "-c", "copy", part)
        part.rename(longer)
    return longer if times > 1 else video


def write_site(source: Path, video: Path, times: int, length_s: float, path: Path) -> None:
    """A site file whose rows are the parts of a repeated file, with the references of the small one."""
    site = first_row(source)
    _, row = site["rows"].popitem()
    site.pop("survey", None)
    for number in range(times):
        part = {
            "video": str(video.resolve()),
            "side": row["passes"][0].get("side", "left"),
            "start_s": number * length_s,
            "end_s": (number + 1) * length_s,
        }
        site["rows"][f"A{number + 1}"] = {**row, "passes": [part]}
    path.write_text(yaml.safe_dump(site), encoding="utf-8")


def measured(command: Sequence[object]) -> Run:
    """Seconds of a command, by the clock and of the processor."""
    before, begin = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    subprocess.run([str(part) for part in command], check=True, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    processor = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return {"clock_s": time.perf_counter() - begin, "processor_s": processor}


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


def map_beside(site: Path, target: Path, jobs: int) -> Run:
    """Map a site in processes, as a user does; stages are not told apart."""
    from savmap.maps.map_file import read_map
    from savmap.maps.run_record import read_log

    with tempfile.TemporaryDirectory() as folder:
        taken = measured([Path(sys.executable).with_name("savmap"), "map", site, "-o", folder, "--jobs", jobs])
        frames = sum(len(row.frames) for row in read_map(Path(folder) / "map.json").rows.values())
        peak = max(row.peak_mb for row in read_log(Path(folder) / "run.json").rows.values())
    write_text(target, json.dumps({"stages": {}, "peak_mb": peak, "frames": frames}))
    return taken


def compared(source: Path, video: Path, times: int, length_s: float, rounds: int, jobs: int) -> Run:
    """Both ways, in turn; sums over all rounds."""
    bound: dict[str, float] = defaultdict(float)
    ours: dict[str, float] = defaultdict(float)
    stages: dict[str, float] = defaultdict(float)
    with tempfile.TemporaryDirectory() as folder:
        site, target = Path(folder) / "site.yaml", Path(folder) / "run.json"
        write_site(source, video, times, length_s, site)
        for _ in range(rounds):
            add(bound, measured(["ffmpeg", "-v", "error", "-threads", "2", "-i", video, "-f", "null", "-"]))
            here = [sys.executable, __file__, "--map", site, "-o", target]
            add(ours, map_beside(site, target, jobs) if jobs else measured(here))
            run = json.loads(target.read_text())
            add(stages, run["stages"])
            ours["peak_mb"] = max(ours["peak_mb"], run["peak_mb"])
    ratios = {key: ours[key] / bound[key] for key in ("clock_s", "processor_s")}
    return {
        "length": times,
        "jobs": jobs,
        "rounds": rounds,
        "frames": run["frames"],
        "bound": dict(bound),
        "ours": dict(ours),
        "stages": dict(stages),
        "ratio": ratios,
    }


def add(total: dict[str, float], more: Mapping[str, float]) -> None:
    for key, value in more.items():
        total[key] += value


def table(result: Run) -> list[str]:
    """Lines for people: processor time by stage, then both ways as a whole."""
    whole = result["ours"]["processor_s"]
    frames = result["frames"] * result["rounds"]
    lines = [
        f"length {result['length']}, {result['frames']} frames used, jobs {result['jobs']}, sums of {result['rounds']} rounds"
    ]
    lines.append(f"{'':24s}{'processor s':>12}{'share':>8}{'ms a frame':>12}{'clock s':>10}")
    for stage, seconds in result["stages"].items():
        lines.append(f"{stage:24s}{seconds:12.1f}{seconds / whole:8.1%}{1e3 * seconds / frames:12.1f}")
    for name, way in (("savmap map", "ours"), ("ffmpeg -threads 2", "bound")):
        seconds, clock = result[way]["processor_s"], result[way]["clock_s"]
        lines.append(f"{name:24s}{seconds:12.1f}{seconds / whole:8.1%}{1e3 * seconds / frames:12.1f}{clock:10.1f}")
    ratio = result["ratio"]
    lines.append(f"ratio {ratio['clock_s']:.2f} by the clock, {ratio['processor_s']:.2f} by processor time")
    lines.append(f"peak memory {result['ours']['peak_mb']:.0f} MB")
    return lines


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--keep", type=Path, help="folder for the generated files")
    parser.add_argument("--source", type=Path, default=SITE, help="a site file; its first row is taken")
    parser.add_argument("--jobs", type=int, default=0, help="processes for rows; 0: this one, with a table of stages")
    parser.add_argument("--rounds", type=int, default=2)
    parser.add_argument("--lengths", default="1,4")
    parser.add_argument("--map", type=Path, help=argparse.SUPPRESS)
    parser.add_argument("-o", "--output", type=Path, default=ROOT / "bench" / "results" / "throughput.json")
    arguments = parser.parse_args()
    if arguments.map:
        map_here(arguments.map, arguments.output)
        return
    from savmap.video.reader import probe

    with tempfile.TemporaryDirectory() as folder:
        keep = arguments.keep or Path(folder)
        keep.mkdir(parents=True, exist_ok=True)
        video = footage(keep, arguments.source)
        length_s = probe(video).duration_s
        results = []
        for times in map(int, arguments.lengths.split(",")):
            rounds = arguments.rounds if times == 1 else 1
            results.append(compared(arguments.source, repeated(video, times), times, length_s, rounds, arguments.jobs))
            print("\n".join(table(results[-1])), end="\n\n", flush=True)
    write_text(arguments.output, json.dumps(results, indent=2) + "\n")


if __name__ == "__main__":
    main()
