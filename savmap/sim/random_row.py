"""Short rows by a seed, each driven past by a cart: footage for checking the whole pipeline."""

from typing import Any

import numpy as np

from savmap.sim.random_scene import random_scene
from savmap.sim.scene import Scene, parse_scene

RACK = "shelves"


def random_row(seed: int, frames: int = 60, width: int = 2048) -> Scene:
    """A place as `random_scene` makes it, whose row A has three to five sections of common widths, all driven past.

    One row in four has a bridge section. The camera is turned any way and sways; its speed changes by up to 40 %.
    """
    rng = np.random.default_rng([seed, 78])
    content = random_scene(seed).model_dump(mode="json")
    rack = content["structures"][RACK]["rows"]["A"]
    rack["bays"] = _bays(rng, rack)
    length = sum(bay["width"] + rack["upright_width"] for bay in rack["bays"]) + rack["upright_width"]
    aisle = content["rows"].get("B", {}).get("z", 2.6)
    content["cart"] = _cart(rng, float(length), float(aisle), float(rack["height"]))
    content["cart"] |= {"frames": frames, "width": width, "fps": 6.0}
    content["hall"]["x"] = [min(content["hall"]["x"][0], -6.0), max(content["hall"]["x"][1], length + 8.0)]
    return parse_scene(content, f"random row {seed}")


def _bays(rng: np.random.Generator, rack: dict[str, Any]) -> list[dict[str, Any]]:
    top = float(rack["height"]) - rack["beam_height"] - 0.1
    bays = [_bay(rng, top, rack["beam_height"]) for _ in range(int(rng.integers(3, 6)))]
    if rng.random() < 0.25 and top > 4.5:
        bridge = bays[int(rng.integers(1, len(bays)))]
        bridge["beams"] = [y for y in bridge["beams"] if y > 2.6] or [top - 0.5]
    return bays


def _bay(rng: np.random.Generator, top: float, beam_height: float) -> dict[str, Any]:
    pitch = max(float(rng.uniform(0.7, 1.5)), beam_height + 0.35)
    levels = np.arange(float(rng.uniform(0.1, 0.4)), top, pitch)
    levels[1:] += rng.uniform(-0.08, 0.08, len(levels) - 1)
    return {"width": float(rng.uniform(2.2, 3.7)), "beams": levels.round(4).tolist(), "empty": bool(rng.random() < 0.1)}


def _cart(rng: np.random.Generator, length: float, aisle: float, height: float) -> dict[str, Any]:
    mast = float(np.clip(height * rng.uniform(0.4, 0.6), 1.4, 3.2))
    z = max(aisle * float(rng.uniform(0.42, 0.58)), 0.3 * max(mast, height - mast))
    ends = [[-0.8, z], [length + 0.8, z]]
    start, end = ends if rng.random() < 0.7 else ends[::-1]
    return {
        "start": start,
        "end": end,
        "height": mast,
        "sway": float(rng.uniform(0.0, 0.08)),
        "weave": float(rng.uniform(0.0, 4.0)),
        "tilt": float(rng.uniform(0.0, 1.5)),
        "speed_variation": float(rng.uniform(0.0, 0.4)),
        "yaw": float(rng.uniform(-180, 180)),
        "pitch": float(rng.uniform(-8, 8)),
        "roll": float(rng.uniform(-8, 8)),
    }
