"""How well `savmap split` finds the passes of simulated recordings: at least six aisles each, and the turns between.

    python bench/split.py FOLDER [--seeds 1 2 3 4] [--width 512] [--fps 10] [--json FILE]

Renders what is not in FOLDER yet (a minute or two of processor time a recording), then prints truth, found and error of each pass.
Exits with 1 where a pass is missed, spurious, or off by more than a second.
"""

import argparse
import json
import sys
import time
from pathlib import Path
from typing import Any

from split_scenes import weaving_scene

from savmap.files.atomic import write_text
from savmap.lab.sim.simulate import simulate
from savmap.split import DetectedPass, find

LIMIT_S = 1.0


def recording(folder: Path, seed: int, width: int, fps: float) -> Path:
    """The folder of a rendered recording, made where it is missing."""
    place = folder / f"weave-{seed}-{width}-{fps:g}"
    if not (place / "footage.mp4").exists():
        simulate(weaving_scene(seed, width, fps=fps), place)
    return place


def scored(place: Path) -> dict[str, Any]:
    """What is found in a recording beside the truth."""
    truth = json.loads((place / "passes.json").read_text(encoding="utf-8"))["passes"]
    begun = time.process_time()
    search = find(place / "footage.mp4")
    cost_s = time.process_time() - begun
    rows = [_row(true, search.passes) for true in truth]
    spurious = len(search.passes) - sum(row["start_s"] is not None for row in rows)
    seconds = float(search.stamps_s[-1])
    return {"passes": rows, "spurious": spurious, "frames_decoded": search.frames_decoded, "processor_s": cost_s, "length_s": seconds}  # fmt: skip


def _row(true: dict[str, Any], passes: tuple[DetectedPass, ...]) -> dict[str, Any]:
    """One true pass, and of the detected ones the one that shares most of its time."""
    sides = [side for side in ("left", "right") if true[side]]
    wanted = {"true_start_s": true["start_s"], "true_end_s": true["end_s"], "true_sides": sides}
    overlaps = [min(p.end_s, true["end_s"]) - max(p.start_s, true["start_s"]) for p in passes]
    if not overlaps or max(overlaps) < 0.5 * (true["end_s"] - true["start_s"]):
        return {**wanted, "start_s": None, "end_s": None, "sides": [], "worst_s": None}
    detected = passes[overlaps.index(max(overlaps))]
    worst = max(abs(detected.start_s - true["start_s"]), abs(detected.end_s - true["end_s"]))
    return {
        **wanted,
        "start_s": detected.start_s,
        "end_s": detected.end_s,
        "sides": list(detected.sides),
        "worst_s": round(worst, 2),
    }


def lines(name: str, result: dict[str, Any]) -> list[str]:
    """A table of one recording."""
    head = f"{name}: {result['length_s']:.0f} s, {result['frames_decoded']} frames decoded, {result['processor_s']:.1f} s of processor time, {result['spurious']} spurious"  # fmt: skip
    said = [head, "  pass  true start   end   found start   end   error start   end   sides (true)"]
    for number, row in enumerate(result["passes"], start=1):
        span = f"  {number:4d}  {row['true_start_s']:10.2f} {row['true_end_s']:6.2f}"
        if row["start_s"] is None:
            said.append(f"{span}   missed")
            continue
        errors = (row["start_s"] - row["true_start_s"], row["end_s"] - row["true_end_s"])
        sides = f"{'+'.join(row['sides'])} ({'+'.join(row['true_sides'])})"
        said.append(
            f"{span}   {row['start_s']:10.2f} {row['end_s']:6.2f}   {errors[0]:+10.2f} {errors[1]:+6.2f}   {sides}"
        )
    return said


def passed(result: dict[str, Any]) -> bool:
    """Whether all passes were found within a second, and nothing else."""
    return not result["spurious"] and all(
        row["worst_s"] is not None and row["worst_s"] <= LIMIT_S for row in result["passes"]
    )


def main() -> int:
    """Render, find, print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--seeds", type=int, nargs="+", default=[1, 2, 3, 4])
    parser.add_argument("--width", type=int, default=512)
    parser.add_argument("--fps", type=float, default=10.0)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    results = {}
    for seed in options.seeds:
        place = recording(options.folder, seed, options.width, options.fps)
        results[place.name] = scored(place)
        print("\n".join(lines(place.name, results[place.name])), flush=True)
    if options.json:
        write_text(options.json, json.dumps(results, indent=1) + "\n")
    good = all(passed(result) for result in results.values())
    print("all passes found within a second" if good else "not all passes were found within a second")
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())
