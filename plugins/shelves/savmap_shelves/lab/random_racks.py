"""Racks of random places, as the simulator's training pictures and random rows show them."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from savmap.lab.scenes import RandomSection, RowPlace, RowSize, Site
from savmap.lab.sim.random_scene import random_color
from savmap.types import Floats

LEANS_PERMILLE, BOWS_SHARE, SAGS_SHARE = (1.0, 12.0), (0.001, 0.008), (0.001, 0.012)
"""Of deformed members: mm in 1 m, and shares of their length. The limits of standards lie inside."""
LEVEL_PERMILLE = 1.0


def random_section(rng: np.random.Generator, site: Site, drawn: RandomSection | None) -> RandomSection | None:
    """One to three rows of racks on either side of an empty aisle; of `drawn`, row A with three to five sections."""
    if drawn is not None:
        return _short(rng, drawn)
    if site.aisle is None or site.frames:
        return None
    rack, other = _rack(rng), _rack(rng)
    if rng.random() < 0.6:
        shared = ("upright_color", "beam_color", "deck", "upright_width")
        other = {**other, **{key: rack[key] for key in shared}}
    rows, racks = _rows(rng, site.aisle, rack, other)
    sizes = {name: _size(rack) for name, rack in racks.items()}
    return RandomSection({"rows": racks}, rows, sizes, (rack["upright_color"], rack["beam_color"]))


def deformed(rack: Mapping[str, Any], rng: np.random.Generator) -> dict[str, Any]:
    """A rack, as a scene file has it, with members out of shape: every other upright leans, and half of these are
    bowed, too; every third beam sags. Beams are as level as floors and connectors leave them, `LEVEL_PERMILLE` each."""
    count = len(rack["bays"]) + 1
    leaning = rng.permutation(count) < (count + 1) // 2
    leans = np.where(leaning, _either_way(rng, LEANS_PERMILLE, count), 0.0)
    bowed = leaning & (rng.random(count) < 0.5)
    bows = np.where(bowed, float(rack["height"]) * _either_way(rng, BOWS_SHARE, count), 0.0)
    bays = [_deformed_bay(rng, bay) for bay in rack["bays"]]
    return {**rack, "bays": bays, "leans": leans.round(3).tolist(), "bows": bows.round(5).tolist()}


def _deformed_bay(rng: np.random.Generator, bay: Mapping[str, Any]) -> dict[str, Any]:
    count = len(bay["beams"])
    tilts = LEVEL_PERMILLE * (rng.normal() + rng.normal(size=count))
    sags = np.where(rng.random(count) < 1 / 3, bay["width"] * rng.uniform(*SAGS_SHARE, count), 0.0)
    return {**bay, "tilts": tilts.round(3).tolist(), "sags": sags.round(5).tolist()}


def _either_way(rng: np.random.Generator, sizes: tuple[float, float], count: int) -> Floats:
    return np.asarray(rng.uniform(*sizes, count) * rng.choice([-1.0, 1.0], count))


def starts(rack: Mapping[str, Any]) -> list[float]:
    """The left edges of the uprights of a rack, as a scene file has it."""
    return [0.0, *np.cumsum([bay["width"] + rack["upright_width"] for bay in rack["bays"]]).tolist()]


def _size(rack: Mapping[str, Any]) -> RowSize:
    return RowSize(starts(rack)[-1] + rack["upright_width"], float(rack["height"]))


def _short(rng: np.random.Generator, drawn: RandomSection) -> RandomSection:
    racks = drawn.section["rows"]
    rack = {**racks["A"], "bays": _short_bays(rng, racks["A"])}
    return RandomSection({"rows": {**racks, "A": rack}}, drawn.rows, {**drawn.sizes, "A": _size(rack)}, drawn.colors)


def _chance(rng: np.random.Generator, share: float) -> bool:
    return bool(rng.random() < share)


def _rack(rng: np.random.Generator) -> dict[str, Any]:
    upright = random_color(rng)
    beam = upright if _chance(rng, 0.15) else random_color(rng)
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
        "rear_color": random_color(rng) if _chance(rng, 0.1) else None,
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


def _rows(
    rng: np.random.Generator, aisle: float, rack: dict[str, Any], other: dict[str, Any]
) -> tuple[dict[str, RowPlace], dict[str, Any]]:
    rows = {"A": RowPlace()}
    racks = {"A": rack}
    gap = float(rng.uniform(0.05, 0.4))
    if _chance(rng, 0.85):
        rows["B"] = RowPlace(x=_size(other).length + float(rng.uniform(-2, 1)), z=aisle, facing="-z")
        racks["B"] = other
    if _chance(rng, 0.65):
        rows["A2"] = RowPlace(x=_size(rack).length, z=-2 * rack["depth"] - gap, facing="-z", mapped=False)
        racks["A2"] = rack
    if _chance(rng, 0.65):
        rows["B2"] = RowPlace(z=aisle + 2 * other["depth"] + gap, mapped=False)
        racks["B2"] = other
    return rows, racks


def _short_bays(rng: np.random.Generator, rack: dict[str, Any]) -> list[dict[str, Any]]:
    top = float(rack["height"]) - rack["beam_height"] - 0.1
    bays = [_short_bay(rng, top, rack["beam_height"]) for _ in range(int(rng.integers(3, 6)))]
    if rng.random() < 0.25 and top > 4.5:
        bridge = bays[int(rng.integers(1, len(bays)))]
        bridge["beams"] = [y for y in bridge["beams"] if y > 2.6] or [top - 0.5]
    return bays


def _short_bay(rng: np.random.Generator, top: float, beam_height: float) -> dict[str, Any]:
    pitch = max(float(rng.uniform(0.7, 1.5)), beam_height + 0.35)
    levels = np.arange(float(rng.uniform(0.1, 0.4)), top, pitch)
    levels[1:] += rng.uniform(-0.08, 0.08, len(levels) - 1)
    return {"width": float(rng.uniform(2.2, 3.7)), "beams": levels.round(4).tolist(), "empty": bool(rng.random() < 0.1)}
