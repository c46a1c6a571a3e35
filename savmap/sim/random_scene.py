"""An endless variety of made-up places for training: colours, racks, goods, lamps, building and light, by a seed."""

from typing import Any

import numpy as np

from savmap.sim.scene import Scene, parse_scene

_PAINTS = np.array(
    [
        [0.02, 0.2, 0.08], [0.03, 0.28, 0.15], [0.02, 0.08, 0.3], [0.03, 0.15, 0.45], [0.35, 0.36, 0.38],
        [0.12, 0.13, 0.14], [0.6, 0.61, 0.6], [0.75, 0.74, 0.7], [0.8, 0.2, 0.02], [0.85, 0.3, 0.03],
        [0.5, 0.04, 0.03], [0.75, 0.5, 0.03], [0.55, 0.5, 0.4], [0.05, 0.05, 0.05], [0.2, 0.3, 0.35],
    ]
)  # fmt: skip
_CARTONS = [[0.48, 0.33, 0.2], [0.42, 0.28, 0.16], [0.55, 0.42, 0.28], [0.35, 0.24, 0.15]]
_BINS = [[0.6, 0.6, 0.6], [0.7, 0.7, 0.68], [0.03, 0.1, 0.4], [0.5, 0.05, 0.03], [0.04, 0.25, 0.08], [0.1, 0.1, 0.11]]


def random_scene(seed: int) -> Scene:
    """A place with one to three rows on either side of an aisle; the same seed gives the same scene."""
    rng = np.random.default_rng([seed, 77])
    aisle = float(rng.uniform(1.8, 4.5))
    rack, other = _rack(rng), _rack(rng)
    if rng.random() < 0.6:
        other = {
            **other,
            **{key: rack[key] for key in ("upright_color", "beam_color", "deck", "upright_width") if key in rack},
        }
    rows, racks = _rows(rng, aisle, rack, other)
    tallest = max(_top(rack) for rack in racks.values())
    hall = _hall(rng, tallest, aisle)
    content = {
        "seed": seed,
        "hall": hall,
        "goods": _goods(rng, rack),
        "look": _look(rng),
        "cart": {"start": [0.5, aisle / 2], "end": [8.0, aisle / 2], "height": min(3.0, tallest)},
        "rows": rows,
        "structures": {"shelves": {"rows": racks}, "lights": {"lines": _lamps(rng, hall["height"], aisle, tallest)}},
    }
    return parse_scene(content, f"random scene {seed}")


def _top(rack: dict[str, Any]) -> float:
    return float(rack["height"])


def _chance(rng: np.random.Generator, share: float) -> bool:
    return bool(rng.random() < share)


def _color(rng: np.random.Generator) -> list[float]:
    base = _PAINTS[int(rng.integers(len(_PAINTS)))]
    if _chance(rng, 0.15):
        base = rng.uniform(0.02, 0.8, 3)
    return [float(c) for c in np.clip(base * rng.uniform(0.7, 1.3) * rng.uniform(0.9, 1.1, 3), 0.01, 0.9)]


def _rack(rng: np.random.Generator) -> dict[str, Any]:
    upright = _color(rng)
    beam = upright if _chance(rng, 0.15) else _color(rng)
    metal = _chance(rng, 0.2)
    beam_height = float(rng.uniform(0.05, 0.1) if _chance(rng, 0.4) else rng.uniform(0.08, 0.18))
    top = float(rng.uniform(2.2, 4.0) if _chance(rng, 0.3) else rng.uniform(4.0, 7.5))
    bays = [_bay(rng, beam_height, top) for _ in range(int(rng.integers(3, 9)))]
    return {
        "bays": bays,
        "height": top + float(rng.uniform(-0.02, 0.4)) + beam_height + 0.05,
        "depth": float(rng.uniform(0.5, 1.3)),
        "upright_width": float(rng.uniform(0.06, 0.14)),
        "upright_depth": float(rng.uniform(0.05, 0.12)),
        "beam_height": beam_height,
        "beam_thickness": float(rng.uniform(0.03, 0.06)),
        "setback": float(rng.choice([0.0, 0.005, 0.01, 0.02])),
        "upright_color": upright,
        "upright_texture": str(rng.choice(["holes", "holes", "holes", "plain", "scratches", "noise"])),
        "hole_pitch": float(rng.choice([0.04, 0.05, 0.075, 0.1])),
        "beam_color": beam,
        "beam_texture": str(rng.choice(["plain", "plain", "scratches", "noise"])),
        "deck": str(rng.choice(["none", "steel", "steel", "wire", "wood"])),
        "deck_color": beam if _chance(rng, 0.4) else [float(rng.uniform(0.1, 0.6))] * 3,
        "rear_color": _color(rng) if _chance(rng, 0.1) else None,
        "bracing": _chance(rng, 0.8),
        "guards": float(rng.choice([0.0, 0.0, 0.5, 1.0])),
        "labels": float(rng.choice([0.0, 0.2, 0.6])),
        "signs": float(rng.choice([0.0, 0.0, 0.3])),
        "metallic": 0.7 if metal else 0.0,
        "roughness": float(rng.uniform(0.25, 0.8)),
    }


def _bay(rng: np.random.Generator, beam_height: float, top: float) -> dict[str, Any]:
    pitch = float(rng.uniform(0.45, 0.9) if _chance(rng, 0.25) else rng.uniform(0.8, 1.8))
    bottom = float(rng.uniform(0.05, 0.4) if _chance(rng, 0.75) else rng.uniform(0.8, 1.6))
    if _chance(rng, 0.12) and top > 4.2:
        bottom = float(rng.uniform(2.6, 3.6))
    levels = np.arange(bottom, top, max(pitch, beam_height + 0.25))
    beams = [float(y) for y in np.sort(levels + rng.uniform(-0.05, 0.05, len(levels)) * (len(levels) > 1))]
    return {
        "width": float(rng.uniform(0.9, 1.8) if _chance(rng, 0.25) else rng.uniform(1.8, 3.7)),
        "beams": [max(y, 0.0) for y in beams],
        "empty": _chance(rng, 0.12),
    }


def _length(rack: dict[str, Any]) -> float:
    return float(sum(bay["width"] + rack["upright_width"] for bay in rack["bays"]) + rack["upright_width"])


def _rows(
    rng: np.random.Generator, aisle: float, rack: dict[str, Any], other: dict[str, Any]
) -> tuple[dict[str, Any], dict[str, Any]]:
    rows: dict[str, Any] = {"A": {"x": 0.0, "z": 0.0}}
    racks = {"A": rack}
    gap = float(rng.uniform(0.05, 0.4))
    if _chance(rng, 0.85):
        rows["B"] = {"x": _length(other) + float(rng.uniform(-2, 1)), "z": aisle, "facing": "-z"}
        racks["B"] = other
    if _chance(rng, 0.65):
        rows["A2"] = {"x": _length(rack), "z": -2 * rack["depth"] - gap, "facing": "-z", "mapped": False}
        racks["A2"] = rack
    if _chance(rng, 0.65):
        rows["B2"] = {"x": 0.0, "z": aisle + 2 * other["depth"] + gap, "mapped": False}
        racks["B2"] = other
    return rows, racks


def _hall(rng: np.random.Generator, tallest: float, aisle: float) -> dict[str, Any]:
    grey = rng.uniform(0.1, 0.65)
    tint = rng.uniform(0.9, 1.1, (4, 3))
    levels = (grey, rng.uniform(0.15, 0.75), rng.uniform(0.05, 0.8), rng.uniform(0.05, 0.7))
    floor, wall, ceiling, steel = (
        np.clip(level * row, 0, 0.85).tolist() for level, row in zip(levels, tint, strict=True)
    )
    painted = {"floor_color": _color(rng)} if _chance(rng, 0.15) else {"floor_color": floor}
    return {
        "x": [-float(rng.uniform(3, 15)), float(rng.uniform(16, 32))],
        "z": [-float(rng.uniform(5, 14)), aisle + float(rng.uniform(5, 14))],
        "height": tallest + float(rng.uniform(0.9, 3.5)),
        **painted,
        "floor_texture": str(rng.choice(["plain", "noise", "noise", "scratches"])),
        "wall_color": wall,
        "ceiling_color": ceiling,
        "steel_color": steel,
        "truss": str(rng.choice(["none", "beams", "beams", "lattice"])),
        "truss_pitch": float(rng.uniform(2.5, 6)),
        "purlin_pitch": float(rng.uniform(0.6, 2)) if _chance(rng, 0.35) else 0.0,
        "pipes": int(rng.integers(0, 5)),
        "skylights": int(rng.choice([0, 0, 0, 0, 2, 5])),
        "windows": int(rng.choice([0, 0, 3])),
        "aisle_marking": _chance(rng, 0.3),
    }


def _goods(rng: np.random.Generator, rack: dict[str, Any]) -> dict[str, Any]:
    colors = list(_CARTONS) + [color for color in _BINS if _chance(rng, 0.4)]
    if _chance(rng, 0.25):
        colors += [rack["upright_color"], rack["beam_color"]]
    if _chance(rng, 0.15):
        colors = [_color(rng) for _ in range(4)]
    return {
        "density": float(rng.uniform(0.2, 0.9)),
        "overhang": float(rng.choice([0.0, 0.04, 0.1, 0.2])),
        "pallets": float(rng.uniform(0, 0.9)),
        "wrap": float(rng.choice([0.0, 0.1, 0.4])),
        "labels": float(rng.uniform(0, 0.8)),
        "colors": colors,
        "debris": float(rng.choice([0.0, 0.1, 0.4])),
    }


def _look(rng: np.random.Generator) -> dict[str, Any]:
    warm = float(rng.uniform(-1, 1))
    return {
        "exposure": float(np.exp(rng.normal(0, 0.3))),
        "ambient": float(rng.uniform(0.03, 0.5)),
        "light_color": [1.0, 1.0 - 0.07 * abs(warm), 1.0 - 0.25 * warm if warm > 0 else 1.0],
        "contrast": float(rng.uniform(0.8, 1.3)),
        "white_balance": [float(c) for c in rng.uniform(0.92, 1.08, 3)],
        "noise": float(rng.uniform(0.0, 0.02)),
        "texel": float(rng.uniform(0.18, 0.4)),
    }


def _lamps(rng: np.random.Generator, ceiling: float, aisle: float, tallest: float) -> list[dict[str, Any]]:
    middle = aisle * float(rng.uniform(0.3, 0.7))
    strip = _chance(rng, 0.6)
    length = float(rng.uniform(0.6, 2.4))
    drop = float(rng.uniform(0.02, min(1.6, ceiling - tallest - 0.4)))
    line = {
        "height": ceiling - drop - 0.05,
        "pitch": float(rng.uniform(length + 0.3, length + 4.0)) if _chance(rng, 0.85) else length + 0.04,
        "kind": "strip" if strip else "compact",
        "across": _chance(rng, 0.2),
        "length": length,
        "width": float(rng.uniform(0.05, 0.25)) if strip else float(rng.uniform(0.2, 0.7)),
        "thickness": float(rng.uniform(0.03, 0.15)),
        "housing": _chance(rng, 0.35),
        "hangers": _chance(rng, 0.5),
        "emission": float(rng.uniform(4, 30)),
        "broken": float(rng.choice([0.0, 0.1, 0.3])),
    }
    places = [middle] + [float(z) for z in (middle - aisle - 2, middle + aisle + 2) if _chance(rng, 0.6)]
    return [{**line, "z": z} for z in places]
