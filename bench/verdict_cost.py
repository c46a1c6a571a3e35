"""What the verdict costs: processor seconds of what a map would not need without it, and their share of one whole `savmap map`.

    python bench/verdict_cost.py [site.yaml] [-o bench/results/verdict_cost.json]

Processor time, so that a busy machine does not matter. The solve with soft references is counted whole, although the solve that follows
begins with its result and needs fewer rounds: the share is an upper bound.
"""

import argparse
import json
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable
from pathlib import Path
from typing import Any

import savmap
from savmap.files.atomic import write_text
from savmap.graph.solver import checks, optimise
from savmap.pipeline import measure, networks, row, view_plans
from savmap.video.motion import PassWatch

ROOT = Path(__file__).parent.parent
PARTS: tuple[tuple[Any, str, str, Callable[[], float]], ...] = (
    (networks, "require_panoramas", "footage: what its pictures are", time.thread_time),
    (view_plans, "require_panoramas", "footage: what its pictures are", time.thread_time),
    (PassWatch, "update", "footage: how the camera went", time.thread_time),
    (measure, "require_course", "footage: how the camera went", time.thread_time),
    (optimise, "_tested", "references: soft solve and tests", time.process_time),
    (checks, "half_differences", "repeatability: odd and even frames", time.process_time),
    (checks, "_panorama_errors", "camera: cropped and bent pictures", time.process_time),
    (row, "judge", "support, shape, residuals", time.process_time),
)
"""What is timed: its owner, its name, what it is for, and a clock: of its own thread while others work, of the process where it is alone."""
SECONDS: dict[str, float] = defaultdict(float)


def timed(owner: Any, name: str, part: str, clock: Callable[[], float]) -> None:
    """Add the processor time of every call of owner.name to a part."""
    inner: Callable[..., Any] = getattr(owner, name)

    def outer(*args: Any, **kwargs: Any) -> Any:
        start = clock()
        try:
            return inner(*args, **kwargs)
        finally:
            SECONDS[part] += clock() - start

    setattr(owner, name, outer)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("site", nargs="?", type=Path, default=ROOT / "savmap" / "demo" / "site.yaml")
    parser.add_argument("-o", "--output", type=Path, default=ROOT / "bench" / "results" / "verdict_cost.json")
    arguments = parser.parse_args()
    for part in PARTS:
        timed(*part)
    with tempfile.TemporaryDirectory() as folder:
        start = time.process_time()
        savmap.map_site(arguments.site, output=folder, jobs=0)
        whole = time.process_time() - start
    for name, seconds in SECONDS.items():
        print(f"{name:38s} {seconds:7.2f} s {seconds / whole:7.1%}")
    print(f"{'the verdict':38s} {sum(SECONDS.values()):7.2f} s {sum(SECONDS.values()) / whole:7.1%}")
    print(f"{'the whole run':38s} {whole:7.2f} s")
    write_text(arguments.output, json.dumps({"parts_s": dict(SECONDS), "whole_s": whole}, indent=2) + "\n")


if __name__ == "__main__":
    main()
