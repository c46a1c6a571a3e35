"""How well `savmap split` finds the passes of simulated recordings: at least six aisles each, and the turns between.

    python -m bench split [--set dev] [--count 4] [--width 512] [--fps 10] [--keep DIR]

Renders what is not in DIR yet (a minute or two of processor time a recording), then prints truth, result and error of each pass of `dev`. Every
seed is another warehouse, through whose six aisles a cart weaves.
"""

import argparse
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from bench.baseline import Figures
from bench.seeds import SETS, is_test, seeds
from savmap.apps.split.find import find
from savmap.apps.split.records import DetectedPass
from savmap.lab.sim.scene.files import Scene, parse_scene
from savmap.lab.sim.simulate import simulate


def weaving_scene(seed: int, width: int = 512, aisles: int = 6, fps: float = 10.0) -> Scene:
    """Rows of racks back to back with aisles between, a path through all of them, with stops, any mounting.

    By the seed's remainder of 4: 1 has a bare wall on one side of the first aisle, 2 leaves an aisle for later, 3 goes back in
    the middle of the first aisle and then on again.
    """
    rng = np.random.default_rng([seed, 41])
    aisle, depth = float(rng.uniform(2.4, 3.4)), float(rng.uniform(0.8, 1.1))
    rack = _rack(rng, depth)
    length = sum(bay["width"] + rack["upright_width"] for bay in rack["bays"]) + rack["upright_width"]
    pitch = aisle + 2 * depth + 0.2
    rows: dict[str, Any] = {}
    for number in range(aisles):
        near = number * pitch
        rows[f"{number + 1}-near"] = {"x": 0.0, "z": near}
        rows[f"{number + 1}-far"] = {"x": length, "z": near + aisle, "facing": "-z"}
    ends = (float(rng.uniform(3.0, 4.5)), float(rng.uniform(3.0, 4.5)))
    if seed % 4 == 1:
        del rows["1-near"]
    order = [0, 2, 1, *range(3, aisles)] if seed % 4 == 2 else list(range(aisles))
    points = _weave(rng, order, pitch, aisle / 2, length, ends)
    if seed % 4 == 3:
        points[1:1] = [[0.8 * length, aisle / 2], [0.1 * length, aisle / 2]]
    height = 3.4 + float(rng.uniform(0.8, 3.0))
    return parse_scene(
        {
            "seed": seed,
            "hall": {
                "x": [-ends[0] - 2.0, length + ends[1] + 2.0],
                "z": [
                    -0.05 if seed % 4 == 1 else -depth - float(rng.uniform(1, 5)),
                    aisles * pitch + float(rng.uniform(1, 5)),
                ],
                "height": height,
                "truss": str(rng.choice(["none", "beams", "lattice"])),
                "floor_texture": str(rng.choice(["plain", "noise", "scratches"])),
            },
            "goods": {"density": float(rng.uniform(0.2, 0.8)), "labels": 0.0},
            "look": {"texel": 0.8, "exposure": float(rng.uniform(0.4, 1.4)), "noise": float(rng.uniform(0.004, 0.015))},
            "cart": {
                "path": {
                    "points": points,
                    "radius": float(rng.uniform(1.2, 1.8)),
                    "speed": float(rng.uniform(0.8, 1.2)),
                    "turn_speed": float(rng.uniform(0.5, 0.8)),
                    "stops": _stops(rng, points),
                },
                "height": float(rng.uniform(1.8, 2.8)),
                "yaw": float(rng.uniform(-180, 180)),
                "speed_variation": float(rng.uniform(0.1, 0.3)),
                "fps": fps,
                "width": width,
            },
            "rows": rows,
            "structures": {
                "shelves": {"rows": dict.fromkeys(rows, rack)},
                "lights": {
                    "lines": [
                        {"z": number * pitch + aisle / 2, "height": height - 0.5, "pitch": 3.0, "length": 1.2}
                        for number in range(aisles)
                    ]
                },
            },
        },
        f"weaving scene {seed}",
    )


def _rack(rng: np.random.Generator, depth: float) -> dict[str, Any]:
    levels = np.arange(0.2, 3.0, float(rng.uniform(0.8, 1.3)))
    bays = [{"width": float(rng.uniform(2.2, 2.9)), "beams": [round(float(y), 3) for y in levels]} for _ in range(3)]
    colors = rng.uniform(0.02, 0.6, (2, 3)).tolist()
    return {"bays": bays, "height": 3.4, "depth": depth, "upright_width": 0.1, "upright_color": colors[0], "beam_color": colors[1]}  # fmt: skip


def _weave(
    rng: np.random.Generator, order: list[int], pitch: float, middle: float, length: float, ends: tuple[float, float]
) -> list[list[float]]:
    """Through the aisles in this order, there and back by turns, with turns in the cross aisles before the hall's walls."""
    out = (-float(rng.uniform(2.0, ends[0] - 0.5)), length + float(rng.uniform(2.0, ends[1] - 0.5)))
    points = [[-1.5, order[0] * pitch + middle]]
    for number, aisle in enumerate(order):
        x = out[1] if number % 2 == 0 else out[0]
        points.append([x, aisle * pitch + middle])
        points += [[x, following * pitch + middle] for following in order[number + 1 : number + 2]]
    points[-1][0] = length + 1.8 if len(order) % 2 else -1.8
    return points


def _stops(rng: np.random.Generator, points: list[list[float]]) -> list[list[float]]:
    total = float(np.abs(np.diff(np.array(points), axis=0)).sum())
    places = sorted(rng.uniform(0.1 * total, 0.9 * total, int(rng.integers(0, 3))).tolist())
    return [[round(place, 2), round(float(rng.uniform(2, 6)), 1)] for place in places]


LIMIT_S = 1.0
Pair = tuple[Mapping[str, Any], DetectedPass | None]


def recording(folder: Path, seed: int, width: int, fps: float) -> Path:
    """The folder of a rendered recording, made where it is missing."""
    place = folder / f"weave-{seed}-{width}-{fps:g}"
    if not (place / "footage.mp4").exists():
        simulate(weaving_scene(seed, width, fps=fps), place)
    return place


def pairs_of(place: Path) -> tuple[list[Pair], int]:
    """The true passes of a recording with what is found of each, and how many more are found."""
    truth = json.loads((place / "passes.json").read_text(encoding="utf-8"))["passes"]
    passes = find(place / "footage.mp4").passes
    pairs = [(true, detected(true, passes)) for true in truth]
    return pairs, len(passes) - sum(hit is not None for _, hit in pairs)


def detected(true: Mapping[str, Any], passes: Sequence[DetectedPass]) -> DetectedPass | None:
    """Of the detected passes the one that shares most of the time of a true one, at least half of it."""

    def shared_s(other: DetectedPass) -> float:
        return float(min(other.end_s, true["end_s"]) - max(other.start_s, true["start_s"]))

    best = max(passes, key=shared_s, default=None)
    return best if best is not None and shared_s(best) >= 0.5 * (true["end_s"] - true["start_s"]) else None


def sides_of(true: Mapping[str, Any]) -> list[str]:
    """On which hands a true pass has a row."""
    return [side for side in ("left", "right") if true[side]]


def line(true: Mapping[str, Any], hit: DetectedPass | None) -> str:
    """True times, errors, sides."""
    off = "missed"
    if hit is not None:
        off = f"off {hit.start_s - true['start_s']:+.2f} {hit.end_s - true['end_s']:+.2f} s, {'+'.join(hit.sides)}"
    return f"  {true['start_s']:.2f} to {true['end_s']:.2f} s, {'+'.join(sides_of(true))}; {off}"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of this bench."""
    parser.add_argument("--set", choices=SETS, default="dev", help="of seeds")
    parser.add_argument("--count", type=int, help="of recordings; all of the set")
    parser.add_argument("--width", type=int, default=512)
    parser.add_argument("--fps", type=float, default=10.0)


def run(given: argparse.Namespace) -> Figures:
    """Counts and errors over all recordings."""
    every, spurious = list[Pair](), 0
    for seed in seeds("recordings", given.set, given.count):
        place = recording(given.keep, seed, given.width, given.fps)
        pairs, more = pairs_of(place)
        every, spurious = [*every, *pairs], spurious + more
        if not is_test("recordings", seed):
            print(f"{place.name}: {more} spurious", *(line(*pair) for pair in pairs), sep="\n", flush=True)
    hits = [(true, hit) for true, hit in every if hit is not None]
    off_s = [max(abs(hit.start_s - true["start_s"]), abs(hit.end_s - true["end_s"])) for true, hit in hits]
    return {
        "total": {
            "passes": len(every),
            "missed": len(every) - len(hits),
            "spurious": spurious,
            "off by more than 1 s": sum(seconds > LIMIT_S for seconds in off_s),
            "largest s": max(off_s, default=float("nan")),
            "sides wrong": sum(sorted(hit.sides) != sorted(sides_of(true)) for true, hit in hits),
        }
    }
