"""Broken videos and folders of pictures, read as `savmap map` reads them: does every one end in a clear error or a report?

    python bench/fuzz.py [--count 8] [--seed 1] [--only WORDS] [--commands 24] [-o bench/results/fuzz.json]

Every file is read in a process of its own with a limit of time and of memory. `count` is the number of files of each kind;
`commands` how many of them also go through the command line. A line for each kind: how many were refused with a clear error,
gave frames with a report of what is missing, were whole, or failed (traceback, hang, crash, memory, frames out of order).
`smeared` are frames used that differ from what was encoded: damage that the decoder did not notice. Exit code 1: failures.
"""

import argparse
import json
import multiprocessing
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
from broken import BYTEWISE, Maker, intact
from broken_headers import HEADERS
from broken_streams import STREAMS
from broken_things import THINGS
from fuzz_walk import Reading, child

from savmap.files.atomic import write_text

KINDS: Mapping[str, Maker] = {"intact": intact, **BYTEWISE, **HEADERS, **STREAMS, **THINGS}
LIMIT_S, LIMIT_MB = 60.0, 1500.0
COMMAND_LIMIT_S = 120.0
REPAIRED = ("Corrupt JPEG data", "Premature end of JPEG")
"""What libjpeg says of a picture that it repaired."""
CODES = {0, 1, 3, 4, 7, 8}
OUTCOMES = ("refused", "reported", "whole", "failed")


@dataclass(frozen=True)
class Case:
    """One broken file: its kind and the number that, with the kind and the seed, makes it."""

    kind: str
    number: int
    reading: Reading


def made(kind: str, number: int, seed: int, folder: Path) -> Path:
    """Write one broken file (always the same for the same kind, number and seed)."""
    folder.mkdir(parents=True)
    return KINDS[kind](folder, np.random.default_rng([seed, number, *kind.encode()]))


def read(path: Path, results: Path) -> Reading:
    """What becomes of a file in a separate process; a process that hangs, dies or grows too large has failed."""
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(["fuzz_walk", "broken_headers", "broken_streams", "broken_things"])
    process = context.Process(target=child, args=(path, results))
    began = time.monotonic()
    process.start()
    process.join(LIMIT_S)
    if process.is_alive():
        process.kill()
        process.join()
        return Reading("failed", f"hangs: not done after {LIMIT_S:g} s", seconds=time.monotonic() - began)
    if process.exitcode or not results.exists():
        return Reading("failed", f"crash: the process ended with {process.exitcode}", seconds=time.monotonic() - began)
    reading = Reading(**json.loads(results.read_text()))
    if reading.peak_mb > LIMIT_MB:
        return replace(reading, outcome="failed", line=f"memory: {reading.peak_mb:.0f} MB; {reading.line}")
    if any(not line.startswith(REPAIRED) for line in reading.noise.splitlines()):
        return replace(
            reading, outcome="failed", line=f"prints `{reading.noise.splitlines()[0][:200]}`; {reading.line}"
        )
    return reading


def cases(kinds: Sequence[str], count: int, seed: int) -> Iterator[Case]:
    """Make and read `count` files of each kind."""
    for kind in kinds:
        for number in range(count):
            with tempfile.TemporaryDirectory() as folder:
                path = made(kind, number, seed, Path(folder) / "in")
                yield Case(kind, number, read(path, Path(folder) / "found.json"))


def commanded(kind: str, number: int, seed: int) -> str:
    """`savmap map` on one file; what is wrong with how it ends, or nothing."""
    with tempfile.TemporaryDirectory() as folder:
        path = made(kind, number, seed, Path(folder) / "in")
        main = "from savmap.cli.app import main; main()"
        options = ["--camera-height", "3.05", "--plugins", "shelves", "-o", str(Path(folder) / "out")]
        try:
            ended = subprocess.run(
                [sys.executable, "-c", main, "map", str(path), *options],
                capture_output=True,
                text=True,
                timeout=COMMAND_LIMIT_S,
                check=False,
            )
        except subprocess.TimeoutExpired:
            return "hangs"
        if ended.returncode not in CODES or "Traceback" in ended.stderr:
            return f"exit code {ended.returncode}: {ended.stderr.strip()[-300:]}"
        lines = [line for line in ended.stderr.splitlines() if line.startswith("savmap: ")]
        return "" if ended.returncode == 0 or len(lines) == 1 else f"says {ended.stderr.strip()[-300:]!r}"


def table(done: Sequence[Case]) -> Iterator[str]:
    """A line for each kind and one for all."""
    yield f"{'kind':28s} {'files':>5s} {'refused':>8s} {'reported':>8s} {'whole':>6s} {'failed':>6s} {'frames':>7s} {'skipped':>7s} {'smeared':>7s} {'s':>5s} {'MB':>5s}"
    for kind in [*dict.fromkeys(case.kind for case in done), "all"]:
        readings = [case.reading for case in done if kind in (case.kind, "all")]
        ends = Counter(reading.outcome for reading in readings)
        counts = " ".join(f"{ends[outcome]:{width}d}" for outcome, width in zip(OUTCOMES, (8, 8, 6, 6), strict=True))
        sums = " ".join(
            f"{sum(getattr(reading, name) for reading in readings):7d}" for name in ("frames", "skipped", "smeared")
        )
        most = (
            f"{max(reading.seconds for reading in readings):5.1f} {max(reading.peak_mb for reading in readings):5.0f}"
        )
        yield f"{kind:28s} {len(readings):5d} {counts} {sums} {most}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=8, help="files of each kind")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", default="", help="kinds whose name holds this")
    parser.add_argument("--commands", type=int, default=24, help="how many go through the command line too")
    parser.add_argument("-o", "--output", type=Path, default=Path(__file__).parent / "results" / "fuzz.json")
    arguments = parser.parse_args()
    kinds = [kind for kind in KINDS if arguments.only in kind]
    done = []
    for case in cases(kinds, arguments.count, arguments.seed):
        done.append(case)
        if case.reading.outcome == "failed" or (case.kind == "intact" and case.reading.outcome != "whole"):
            print(f"{case.kind} {case.number}: {case.reading.line}", flush=True)
    print(*table(done), sep="\n")
    rng = np.random.default_rng(arguments.seed)
    chosen = rng.permutation(len(done))[: arguments.commands]
    wrong = {
        f"{done[i].kind} {done[i].number}": commanded(done[i].kind, done[i].number, arguments.seed) for i in chosen
    }
    bad = {name: what for name, what in wrong.items() if what}
    print(
        f"command line: {len(wrong)} files, {len(bad)} wrong",
        *(f"{name}: {what}" for name, what in bad.items()),
        sep="\n",
    )
    content = {"cases": [asdict(case) for case in done], "commands": wrong}
    write_text(arguments.output, json.dumps(content, indent=1) + "\n")
    sys.exit(1 if bad or any(case.reading.outcome == "failed" for case in done) else 0)


if __name__ == "__main__":
    main()
