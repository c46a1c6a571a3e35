"""Random rows changed: longer ones, grey ones, and such as have a gap or a passage in them."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from savmap.lab.sim.scene.files import Scene, parse_scene


def lengthened(scene: Scene, times: int) -> Scene:
    """The scene with the first rack's bays so many times over, the others, the hall and the drive longer by as much."""
    content = scene.model_dump(mode="json")
    racks, cart = content["structures"]["shelves"]["rows"], content["cart"]
    more = (times - 1) * _length(next(iter(racks.values())))
    for name, rack in racks.items():
        before, bays = _length(rack), rack["bays"]
        count = max(1, round(len(bays) * (before + more) / before))
        rack["bays"] = [bays[number % len(bays)] for number in range(count)]
        if content["rows"][name]["facing"] == "-z":
            content["rows"][name]["x"] += _length(rack) - before
    content["hall"]["x"][1] += more + 6.0
    cart["start" if cart["start"][0] > cart["end"][0] else "end"][0] += more
    cart["frames"] *= times
    return parse_scene(content, "long row")


def _length(rack: Mapping[str, Any]) -> float:
    """m."""
    return float(sum(bay["width"] for bay in rack["bays"]))


def greyed(scene: Scene, seed: int) -> Scene:
    """The scene with its racks' beams and decks in one grey, under light that comes from everywhere."""
    rng = np.random.default_rng([seed, 9])
    content = scene.model_dump(mode="json")
    for rack in content["structures"]["shelves"]["rows"].values():
        grey = float(rng.uniform(0.3, 0.6))
        post = grey if rng.random() < 0.5 else float(rng.uniform(0.1, 0.7))
        rack |= {"beam_color": [grey] * 3, "deck_color": [grey * float(rng.uniform(0.93, 1.07))] * 3, "deck": "steel"}
        rack |= {"upright_color": [post] * 3, "beam_texture": "plain", "metallic": 0.0, "labels": 0.0}
    content["look"] |= {"ambient": 0.6, "contrast": 0.9}
    return parse_scene(content, f"grey row {seed}")


def interrupted(scene: Scene, gap: float) -> Scene:
    """The scene with a bay without beams, so many metres wide, in the middle of the first rack; the hall and the drive longer by as much.

    Racks behind stay as they are, and are seen through it."""
    content = scene.model_dump(mode="json")
    rack, cart = next(iter(content["structures"]["shelves"]["rows"].values())), content["cart"]
    before, more = abs(cart["end"][0] - cart["start"][0]), gap + rack["upright_width"]
    rack["bays"].insert(len(rack["bays"]) // 2, {"width": gap, "beams": [], "empty": True})
    content["hall"]["x"][1] += more
    cart["start" if cart["start"][0] > cart["end"][0] else "end"][0] += more
    cart["frames"] = round(cart["frames"] * (before + more) / before)
    return parse_scene(content, "interrupted row")
