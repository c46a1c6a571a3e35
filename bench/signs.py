"""Signs of made-up rows, mapped: how many legible ones are found and read, how far their corners are off, and is any text made up?

    python -m bench signs [--set dev] [--count 6] [--frames 36] [--width 4096] [--keep DIR]

A row as `random_row` makes it gets a bay sign (30 x 15 cm) at every upright, in some rows with an AprilTag, and signs (80 x 40 cm)
that hang across the aisle. A sign counts as legible where it was in sight, whole and clear of goods, in three frames or more with
letters at least 8 pixels of the panorama high. "inside": the corners' coordinates within 1.96 of their standard deviations.
"""

import argparse
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import yaml

import savmap
from bench.baseline import Figures
from bench.seeds import SETS, is_test, seeds
from savmap.lab.sim.drive.cart import Drive, drive
from savmap.lab.sim.random_row import random_row
from savmap.lab.sim.render.raycast import Caster
from savmap.lab.sim.scene.build import build
from savmap.lab.sim.scene.files import Scene, parse_scene
from savmap.lab.sim.simulate import simulate
from savmap.types import Floats, Structure
from savmap_shelves.lab.random_racks import starts
from savmap_signs.evaluation import SurveyedSign, match_signs, read_row, same_text

LETTER_PX, FRAMES = 8.0, 3
LETTER_SHARE = 0.33
TINY_M = 1e-6
PATTERN = r"[A-Z]\d{2}-\d{2}|AISLE [A-Z]\d{2}"


def signed_row(seed: int, frames: int, width: int) -> Scene:
    """A row with signs."""
    rng = np.random.default_rng([seed, 91])
    content = random_row(seed, frames, width).model_dump(mode="json")
    rack, cart = content["structures"]["shelves"]["rows"]["A"], content["cart"]
    name = f"{'ABCDEFGH'[int(rng.integers(8))]}{rng.integers(10, 60)}"
    plates = _bay_signs(rng, rack, name, float(cart["height"]))
    aisle = float(content["rows"].get("B", {}).get("z", 2.6))
    height = min(float(cart["height"]) + float(rng.uniform(0.7, 1.1)), float(content["hall"]["height"]) - 0.4)
    for x in np.arange(1.0, starts(rack)[-1], 4.5).tolist():
        text = f"AISLE\n{name}" if rng.random() < 0.5 else f"{name}-{rng.integers(10, 99)}"
        at = [x, height, aisle / 2]
        plates.append(
            {"at": at, "size": [0.8, 0.4], "text": text, "facing": "x", "hung": True, "paper": [0.85, 0.6, 0.02]}
        )
    content["structures"]["signs"] = {"plates": plates}
    return parse_scene(content, f"row with signs {seed}")


def _bay_signs(rng: np.random.Generator, rack: Mapping[str, Any], name: str, eye: float) -> list[dict[str, Any]]:
    height = min(max(eye - float(rng.uniform(0.2, 0.7)), 1.3), float(rack["height"]) - 0.3)
    code = str(rng.choice(["none", "none", "tag36h11"]))
    return [
        {
            "at": [x + rack["upright_width"] / 2, height, 0.004],
            "text": f"{name}-{number:02d}",
            "code": code,
            "content": str(number),
            "bay": number,
            "border": bool(rng.random() < 0.3),
        }
        for number, x in enumerate(starts(dict(rack))[:-1], start=1)
    ]


def legible(scene: Scene, caster: Caster, path: Drive, sign: SurveyedSign) -> bool:
    """Whether enough frames show a sign's letters large enough, with nothing before it. Mapped row A is the world's frame."""
    corners = np.array(sign.corners)
    lines = max(len(sign.text.split()), 1)
    letter = LETTER_SHARE * float(np.linalg.norm(corners[3] - corners[0])) / lines
    normal = np.cross(corners[3] - corners[0], corners[1] - corners[0])
    normal /= np.linalg.norm(normal)
    inner = corners.mean(0) + 0.9 * (corners - corners.mean(0))
    points = np.concatenate([inner, corners.mean(0)[None]]) + 0.003 * normal
    seen = 0
    for origin in path.origins:
        away = points - origin
        reach = np.linalg.norm(away, axis=1)
        facing = float(-(away[-1] / reach[-1]) @ normal)
        big = letter / reach[-1] * scene.cart.width / (2 * np.pi) >= LETTER_PX
        if big and facing > 0.35:
            start = np.repeat(origin[None], len(points), axis=0)
            seen += not caster.blocked(start, away / reach[:, None], reach - 0.004).any()
    return seen >= FRAMES


def judged(scene: Scene, structures: Sequence[Structure]) -> dict[str, Any]:
    """The figures of one row."""
    built = build(scene)
    surveyed = read_row(built.survey["rows"]["A"])
    caster, path = Caster(built.boxes), drive(scene.cart, scene.seed)
    signs = [sign for sign in structures if sign.label == "sign"]
    partner = match_signs(surveyed.corners(), signs)
    readable = [i for i, sign in enumerate(surveyed.signs) if legible(scene, caster, path, sign)]
    off = {i: np.linalg.norm(surveyed.corners()[i] - signs[j].vertices, axis=1) for i, j in partner.items()}
    inside = [within(surveyed.corners()[i] - signs[j].vertices, signs[j].covariances) for i, j in partner.items()]
    true = {j: i for i, j in partner.items()}
    invented = [
        sign.attributes["text"]
        for j, sign in enumerate(signs)
        if sign.attributes["text"] and not (j in true and same_text(surveyed.signs[true[j]], sign))
    ]
    return {
        "signs": len(surveyed.signs),
        "legible": len(readable),
        "found": sum(i in partner for i in readable),
        "read": sum(i in partner and same_text(surveyed.signs[i], signs[partner[i]]) for i in readable),
        "corners_m": np.concatenate([np.zeros(0), *(off[i] for i in readable if i in off)]).round(4).tolist(),
        "inside": round(float(np.mean(inside)), 4) if inside else None,
        "invented": invented,
        "spurious": len(signs) - len(partner),
        "not_read": [
            surveyed.signs[i].text
            for i in readable
            if i not in partner or not same_text(surveyed.signs[i], signs[partner[i]])
        ],
    }


def within(errors: Floats, covariances: Floats) -> Floats:
    """Which coordinates (4, 3) are off by no more than 1.96 standard deviations."""
    sigmas = np.sqrt(np.einsum("kii->ki", covariances))
    return np.asarray(np.abs(errors) <= 1.96 * sigmas + TINY_M, np.float64)


def figures_of(seed: int, frames: int, width: int, folder: Path) -> dict[str, Any]:
    """Footage of a row where there is none yet, its map, its figures."""
    scene = signed_row(seed, frames, width)
    if not (folder / "footage.mp4").is_file():
        simulate(scene, folder)
    site = yaml.safe_load((folder / "site.yaml").read_text())
    site["plugins"] = {"shelves": site["plugins"]["shelves"], "signs": {"pattern": PATTERN}}
    site["rows"] = {"A": site["rows"]["A"]}
    (folder / "signs.yaml").write_text(yaml.safe_dump(site, sort_keys=False))
    site_map = savmap.map_site(folder / "signs.yaml", output=folder / "out")
    return judged(scene, site_map.rows["A"].structures["signs"])


def line(seed: int, figures: Mapping[str, Any]) -> str:
    """One row of the table."""
    corners = np.array(figures["corners_m"] or [np.nan])
    return (
        f"{seed:6d} {figures['signs']:6d} {figures['legible']:8d} {figures['found']:6d} {figures['read']:5d} {100 * corners.mean():8.2f} "
        f"{100 * np.percentile(corners, 95):8.2f} {100 * corners.max():8.2f} {100 * (figures['inside'] or 0):8.1f} "
        f"{len(figures['invented']):9d} {figures['spurious']:9d}"
    )


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of this bench."""
    parser.add_argument("--set", choices=SETS, default="dev", help="of seeds")
    parser.add_argument("--count", type=int, help="of rows; all of the set")
    parser.add_argument("--frames", type=int, default=36)
    parser.add_argument("--width", type=int, default=4096)


def run(given: argparse.Namespace) -> Figures:
    """Figures over all rows; a line for each of `dev`."""
    results = []
    print("  seed  signs  legible  found  read  mean cm  95 % cm   max cm  inside %  invented  spurious", flush=True)
    for seed in seeds("signs", given.set, given.count):
        folder = given.keep / f"row-{seed}"
        results.append(figures_of(seed, given.frames, given.width, folder))
        if not is_test("signs", seed):
            print(line(seed, results[-1]), flush=True)
    corners = np.concatenate([result["corners_m"] for result in results])
    counts = ("signs", "legible", "found", "read", "spurious")
    return {
        "total": {
            **{name: sum(result[name] for result in results) for name in counts},
            "invented": sum(len(result["invented"]) for result in results),
            "mean cm": 100 * float(corners.mean()),
            "95 % cm": 100 * float(np.percentile(corners, 95)),
            "largest cm": 100 * float(corners.max()),
        }
    }
