"""Made-up places of the simulator, dressed with signs of all kinds, for training."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from savmap.sim.scene import Scene, parse_scene
from savmap_signs.artwork import FONTS

RACK = "shelves"
PAPERS = (
    [0.85, 0.85, 0.82], [0.8, 0.8, 0.78], [0.85, 0.6, 0.02], [0.8, 0.35, 0.02], [0.02, 0.12, 0.45],
    [0.03, 0.25, 0.08], [0.6, 0.03, 0.03], [0.03, 0.03, 0.03], [0.5, 0.55, 0.55],
)  # fmt: skip
LIGHT, DARK = [0.9, 0.9, 0.88], [0.01, 0.01, 0.01]
LETTERS = "ABCDEFGHJKLMNPRSTUVWXYZ"


def dressed(scene: Scene, seed: int) -> Scene:
    """A scene with racks, and signs on them and over the aisle; the same seed gives the same signs."""
    rng = np.random.default_rng([seed, 79])
    content = scene.model_dump(mode="json")
    racks = content["structures"][RACK]["rows"]
    hall, aisle = content["hall"]["height"], _aisle(content)
    plates: list[dict[str, Any]] = []
    for name, rack in racks.items():
        if content["rows"][name]["mapped"]:
            plates += _on_rack(rng, name, rack)
    plates += _hung(rng, racks["A"], hall, aisle)
    content["structures"]["signs"] = {"plates": plates}
    return parse_scene(content, f"dressed scene {seed}")


def starts(rack: dict[str, Any]) -> list[float]:
    """The left edges of a rack's uprights."""
    return [0.0, *np.cumsum([bay["width"] + rack["upright_width"] for bay in rack["bays"]]).tolist()]


def looks(rng: np.random.Generator) -> dict[str, Any]:
    """Colours, font and border of one series of signs."""
    paper = PAPERS[int(rng.integers(len(PAPERS)))]
    luminous = float(np.dot(paper, [0.2, 0.7, 0.1]))
    ink = LIGHT if luminous < 0.15 or (luminous < 0.35 and rng.random() < 0.5) else DARK
    return {
        "paper": [float(c) for c in np.clip(np.array(paper) * rng.uniform(0.8, 1.1, 3), 0.01, 0.9)],
        "ink": ink,
        "font": FONTS[int(rng.integers(len(FONTS)))],
        "border": bool(rng.random() < 0.4),
    }


def _aisle(content: dict[str, Any]) -> float:
    return float(content["rows"].get("B", {}).get("z", 2.6))


def text_of(rng: np.random.Generator, number: int) -> str:
    letter = LETTERS[int(rng.integers(len(LETTERS)))]
    kinds = (
        f"{letter}{rng.integers(10, 99)}-{number:02d}",
        f"{letter}{number}",
        f"{rng.integers(10, 99)}-{number:02d}",
        f"{letter}{letter}{rng.integers(100, 999)}",
        f"AISLE\n{letter}{number:02d}",
    )
    return kinds[int(rng.integers(len(kinds)))]


def _on_rack(rng: np.random.Generator, row: str, rack: dict[str, Any]) -> Iterator[dict[str, Any]]:
    """Signs at uprights, signs at beams, small labels with codes, and flags that stand out of the rack."""
    style, share = looks(rng), float(rng.uniform(0.3, 1.0))
    size = float(rng.uniform(0.16, 0.45)), float(rng.uniform(0.08, 0.25))
    height = float(rng.uniform(1.2, min(3.2, rack["height"] - 0.3)))
    mount = rng.choice(["upright", "beam", "flag"], p=[0.45, 0.4, 0.15])
    for number, x in enumerate(starts(rack)[:-1], start=1):
        if rng.random() > share:
            continue
        plate = {"row": row, "bay": number, "size": size, "text": text_of(rng, number), **style}
        if mount == "flag":
            at = [x + rack["upright_width"] / 2, height, size[0] / 2 + 0.03]
            yield plate | {"at": at, "facing": "x"}
        else:
            yield plate | {"at": _front(rng, rack, number, x, height, str(mount))} | code_of(rng)
    yield from _labels(rng, row, rack)


def _front(rng: np.random.Generator, rack: dict[str, Any], number: int, x: float, y: float, mount: str) -> list[float]:
    beams = rack["bays"][number - 1]["beams"]
    if mount == "upright" or not beams:
        return [x + rack["upright_width"] / 2, y, 0.004]
    beam = min(beams, key=lambda bottom: abs(bottom - y))
    middle = x + rack["upright_width"] + rack["bays"][number - 1]["width"] * float(rng.uniform(0.2, 0.8))
    return [middle, beam + rack["beam_height"] / 2, 0.004]


def code_of(rng: np.random.Generator) -> dict[str, Any]:
    kind = str(rng.choice(["none", "qr", "tag36h11"], p=[0.6, 0.25, 0.15]))
    return {"code": kind, "content": str(rng.integers(0, 500)) if kind == "tag36h11" else ""}


def _labels(rng: np.random.Generator, row: str, rack: dict[str, Any]) -> Iterator[dict[str, Any]]:
    if rng.random() < 0.5:
        return
    height = rack["beam_height"] * float(rng.uniform(0.6, 0.95))
    for number, (bay, x) in enumerate(zip(rack["bays"], starts(rack), strict=False), start=1):
        for level, beam in enumerate(bay["beams"], start=1):
            if rng.random() < 0.6:
                middle = x + rack["upright_width"] + bay["width"] * float(rng.uniform(0.1, 0.9))
                text, kind = f"{number:02d}-{level}", str(rng.choice(["qr", "none"]))
                at = [middle, beam + rack["beam_height"] / 2, 0.004 - rack["setback"]]
                yield {"row": row, "at": at, "size": [height * 2.2, height], "text": text, "code": kind, "bay": number}


def _hung(rng: np.random.Generator, rack: dict[str, Any], ceiling: float, aisle: float) -> Iterator[dict[str, Any]]:
    """Signs over the aisle, across it or along it."""
    if rng.random() < 0.15:
        return
    style = looks(rng)
    size = float(rng.uniform(0.5, 1.2)), float(rng.uniform(0.25, 0.6))
    height = float(rng.uniform(2.6, max(2.7, min(5.0, ceiling - 0.6))))
    across = rng.random() < 0.75
    for number, x in enumerate(np.arange(rng.uniform(0, 3), starts(rack)[-1] + 2, rng.uniform(2.5, 6)).tolist()):
        at = [x, height, aisle * float(rng.uniform(0.35, 0.65))]
        facing = "x" if across else "+z"
        yield {"at": at, "size": size, "text": text_of(rng, number), "facing": facing, "hung": True, **style}
