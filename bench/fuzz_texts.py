"""Broken texts, read and used as the commands do: site files, scenes, options, maps, surveys, tables and drawings of
surveyors, runs, networks, labels.

    python bench/fuzz_texts.py [--count 10000] [--seed 1] [--only WORDS] [--keep FOLDER] [-o bench/results/fuzz_texts.json]

Hypothesis mutates sound files by their structure, and some of them byte by byte. Each is read in a process of its own kind, with limits
of time and memory. A line for each kind: how many were refused in one line, were used, or went wrong: a traceback (or output that acts
on a terminal), a hang of more than 10 s, more than 2 GB. Exit code 1 where any went wrong; `--keep` keeps those files.
"""

import argparse
import json
import multiprocessing
import resource
import shutil
import sys
import tempfile
import time
import traceback
import warnings
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cache
from multiprocessing.connection import Connection
from pathlib import Path

from fuzz_mutations import texts
from fuzz_uses import Kind, WrongError, kinds, refusal_of
from hypothesis import HealthCheck, Phase, given, seed, settings

from savmap.errors import SavmapError
from savmap.files.atomic import write_text

LIMIT_S, LIMIT_MB, ADDRESS_SPACE = 10.0, 2000.0, 16 << 30
BATCH, STARTING_S = 250, 120.0
OUTCOMES = ("refused", "used", "traceback", "hang", "memory")


@dataclass(frozen=True)
class Outcome:
    """How a text ended: `refused` in one line, `used`, or wrong; its line, and s and MB that it took (MB of the process so far)."""

    kind: str
    number: int
    ending: str
    line: str
    seconds: float = 0.0
    peak_mb: float = 0.0


def tried(kind: str, path: Path, number: int) -> Outcome:
    """What becomes of one file."""
    begun = time.monotonic()
    try:
        kinds_here()[kind].use(path)
        ending, line = "used", ""
    except SavmapError as error:
        try:
            ending, line = "refused", refusal_of(error)
        except WrongError as wrong:
            ending, line = "traceback", str(wrong)
    except (Exception, RecursionError, MemoryError) as error:
        ending, line = "traceback", f"{type(error).__name__}: {error!s:.200} {traceback.format_exc()[-1500:]}"
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    return Outcome(kind, number, ending, line, round(time.monotonic() - begun, 3), round(peak, 1))


@cache
def kinds_here() -> Mapping[str, Kind]:
    """The kinds, made once in a process."""
    return kinds()


def batch(kind: str, number: int, count: int, folder: Path, to: Connection) -> None:
    """Make and try `count` texts of a kind; before and after each, say so."""
    warnings.simplefilter("ignore")
    resource.setrlimit(resource.RLIMIT_AS, (ADDRESS_SPACE, ADDRESS_SPACE))
    own, done = kinds_here()[kind], iter(range(number, number + count))

    @seed(number)
    @settings(
        max_examples=count,
        database=None,
        deadline=None,
        phases=[Phase.generate],
        suppress_health_check=list(HealthCheck),
    )
    @given(texts(own.seed, own.written, own.bombs))
    def each(content: bytes) -> None:
        index = next(done, None)
        if index is None:
            return
        with tempfile.TemporaryDirectory(dir=folder) as place:
            path = Path(place) / own.name
            path.write_bytes(content)
            (folder / "last").write_bytes(content)
            to.send(index)
            to.send(tried(kind, path, index))

    each()
    to.send(None)


def outcomes(kind: str, count: int, first: int, keep: Path | None) -> Iterator[Outcome]:
    """Try `count` texts of a kind, in processes that are ended where one hangs or dies."""
    context, number = multiprocessing.get_context("spawn"), 0
    while number < count:
        size = min(BATCH, count - number)
        with tempfile.TemporaryDirectory() as folder:
            here, there = context.Pipe(duplex=False)
            process = context.Process(target=batch, args=(kind, first + number, size, Path(folder), there))
            process.start()
            there.close()
            got = 0
            for outcome in received(here, kind, first + number):
                got += 1
                if keep is not None and outcome.ending not in ("refused", "used"):
                    keep.mkdir(parents=True, exist_ok=True)
                    shutil.copy(Path(folder) / "last", keep / f"{kind.replace(' ', '-')}-{outcome.number}")
                yield outcome
            process.kill()
            process.join()
        if got == 0:
            raise SystemExit(f"{kind}: nothing could be tried")
        number += got


def received(here: Connection, kind: str, first: int) -> Iterator[Outcome]:
    """What a process says of its texts, up to its end, or up to the text with which it hangs or dies."""
    last = first
    waited = STARTING_S
    while True:
        try:
            if not here.poll(waited):
                yield Outcome(kind, last, "hang", f"not done after {waited:g} s", waited)
                return
            said = here.recv()
        except EOFError:
            yield Outcome(kind, last, "traceback", "the process ended")
            return
        if said is None:
            return
        if isinstance(said, int):
            last, waited = said, LIMIT_S
        else:
            waited = STARTING_S
            large = said.peak_mb > LIMIT_MB
            yield Outcome(kind, said.number, "memory", said.line, said.seconds, said.peak_mb) if large else said
            if large:
                return


def table(done: Sequence[Outcome]) -> Iterator[str]:
    """A line for each kind and one for all."""
    yield (
        f"{'kind':18s} {'texts':>6s} " + " ".join(f"{name:>9s}" for name in OUTCOMES) + f" {'s at most':>9s} {'MB':>6s}"
    )
    for kind in [*dict.fromkeys(one.kind for one in done), "all"]:
        own = [one for one in done if kind in (one.kind, "all")]
        ends = Counter(one.ending for one in own)
        counts = " ".join(f"{ends[name]:9d}" for name in OUTCOMES)
        yield f"{kind:18s} {len(own):6d} {counts} {max(one.seconds for one in own):9.1f} {max(one.peak_mb for one in own):6.0f}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=10_000, help="texts of all kinds together")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", default="", help="kinds whose name holds this")
    parser.add_argument("--keep", type=Path, help="a folder for the texts that went wrong")
    parser.add_argument("-o", "--output", type=Path, default=Path(__file__).parent / "results" / "fuzz_texts.json")
    arguments = parser.parse_args()
    chosen = [kind for kind in kinds_here() if arguments.only in kind]
    done: list[Outcome] = []
    for kind in chosen:
        for outcome in outcomes(kind, -(-arguments.count // len(chosen)), arguments.seed * 1_000_000, arguments.keep):
            done.append(outcome)
            if outcome.ending not in ("refused", "used"):
                print(f"{outcome.kind} {outcome.number}: {outcome.ending}: {outcome.line}", flush=True)
    print(*table(done), sep="\n")
    wrong = [one for one in done if one.ending not in ("refused", "used")]
    counts = {kind: Counter(one.ending for one in done if one.kind == kind) for kind in chosen}
    content = {"seed": arguments.seed, "texts": len(done), "counts": counts, "wrong": [asdict(one) for one in wrong]}
    write_text(arguments.output, json.dumps(content, indent=1) + "\n")
    sys.exit(1 if wrong else 0)


if __name__ == "__main__":
    main()
