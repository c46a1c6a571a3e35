"""Made-up warehouses for `bench/split.py`: a cart weaves through six aisles or more; every seed is another place."""

from typing import Any

import numpy as np

from savmap.lab.sim.scene.files import Scene, parse_scene


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
