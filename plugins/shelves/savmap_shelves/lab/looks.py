"""Made-up places that networks are poor at: racks in the grey of their goods, and dark ones in dark halls."""

from typing import Any

import numpy as np

from savmap.lab.sim.random_scene import random_scene
from savmap.lab.sim.scene.files import Scene, parse_scene


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


def darkened(scene: Scene, seed: int) -> Scene:
    """A scene with its racks thin and galvanised, and everything dark."""
    rng = np.random.default_rng([seed, 5])

    def grey(low: float, high: float) -> list[float]:
        return [float(rng.uniform(low, high))] * 3

    content = scene.model_dump(mode="json")
    for rack in content["structures"]["shelves"]["rows"].values():
        steel = grey(0.05, 0.12)
        rack |= {f"{part}_color": steel for part in ("upright", "beam", "rear", "deck")}
        rack |= {"deck": "wire", "metallic": 0.7, "roughness": 0.3}
        rack |= {"upright_texture": "scratches", "beam_texture": "scratches"}
        rack |= {"upright_width": float(rng.uniform(0.035, 0.05)), "beam_height": float(rng.uniform(0.04, 0.06))}
    content["hall"] |= {f"{part}_color": grey(0.03, 0.09) for part in ("floor", "wall", "ceiling", "steel")}
    content["goods"]["colors"] = [grey(0.03, 0.15) for _ in range(4)]
    content["look"] |= {"ambient": 0.03, "exposure": float(rng.uniform(0.25, 0.5)), "noise": 0.03, "contrast": 1.2}
    return parse_scene(content, f"dark scene {seed}")


def dark_scene(seed: int) -> Scene:
    """The random place of a seed, darkened."""
    return darkened(random_scene(seed), seed)


def grey_scene(seed: int) -> Scene:
    """The random place of a seed, greyed."""
    return greyed(random_scene(seed), seed)


def pale_scene(seed: int) -> Scene:
    """The random place of a seed with racks, decks, goods and hall of one shade, from dark grey to white; lowest beams
    are near the floor."""
    rng = np.random.default_rng([seed, 11])
    content = random_scene(seed).model_dump(mode="json")
    shade = float(rng.uniform(0.12, 0.8))

    def near() -> list[float]:
        return [float(np.clip(shade * rng.normal(1.0, 0.08) * rng.normal(1.0, 0.02), 0.02, 0.9)) for _ in range(3)]

    for rack in content["structures"]["shelves"]["rows"].values():
        rack |= {f"{part}_color": near() for part in ("upright", "beam", "rear", "deck")}
        rack |= {"metallic": 0.7 if rng.random() < 0.4 else 0.0, "deck": str(rng.choice(["steel", "wire"]))}
        _lower(rack, rng)
    content["hall"] |= {f"{part}_color": near() for part in ("floor", "wall", "steel")}
    content["goods"]["colors"] = [near() for _ in range(4)]
    content["look"] |= {"ambient": float(rng.uniform(0.2, 0.7)), "contrast": float(rng.uniform(0.8, 1.1))}
    return parse_scene(content, f"pale scene {seed}")


def dim_scene(seed: int) -> Scene:
    """The random place of a seed at a fifth to a half of its light, with noise, and shadows below what hangs; lowest
    beams are near the floor."""
    rng = np.random.default_rng([seed, 13])
    content = random_scene(seed).model_dump(mode="json")
    for rack in content["structures"]["shelves"]["rows"].values():
        _lower(rack, rng)
    exposure = content["look"]["exposure"] * float(rng.uniform(0.2, 0.5))
    content["look"] |= {"exposure": exposure, "noise": float(rng.uniform(0.015, 0.045))}
    content["look"]["ambient"] = float(rng.uniform(0.02, 0.12))
    return parse_scene(content, f"dim scene {seed}")


def _lower(rack: dict[str, Any], rng: np.random.Generator) -> None:
    """Half of the bays get their lowest beam within 15 cm of the floor, or one there."""
    for bay in rack["bays"]:
        if rng.random() < 0.5:
            low = float(rng.uniform(0.0, 0.15))
            higher = [y for y in bay["beams"] if y > low + rack["beam_height"] + 0.3]
            bay["beams"] = [low, *higher]
