"""Short rows by a seed, each driven past by a cart: footage for checking the whole pipeline."""

from typing import Any

import numpy as np

from savmap.lab.plugins import furnishing_plugins
from savmap.lab.sim.random_scene import furnished
from savmap.lab.sim.scene.files import Scene, parse_scene

ROW = "A"


def random_row(seed: int, frames: int = 60, width: int = 2048) -> Scene:
    """A place as `random_scene` makes it, with row A made short by its plugin, and driven past as a whole.

    The camera is turned any way and sways; its speed changes by up to 40 %.
    """
    rng = np.random.default_rng([seed, 78])
    place = furnished(seed)
    content = place.scene.model_dump(mode="json")
    size = place.site.sizes[ROW]
    plugins = {plugin.name: plugin for plugin in furnishing_plugins()}
    for name, drawn in place.sections.items():
        short = plugins[name].random_section(rng, place.site, drawn)
        if short is not None:
            content["structures"][name] = dict(short.section)
            size = short.sizes.get(ROW, size)
    aisle = content["rows"].get("B", {}).get("z", 2.6)
    content["cart"] = _cart(rng, size.length, float(aisle), size.height)
    content["cart"] |= {"frames": frames, "width": width, "fps": 6.0}
    content["hall"]["x"] = [min(content["hall"]["x"][0], -6.0), max(content["hall"]["x"][1], size.length + 8.0)]
    return parse_scene(content, f"random row {seed}")


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
