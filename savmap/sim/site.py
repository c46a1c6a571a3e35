"""A site file for simulated footage: what a user who had driven there would write."""

from collections.abc import Mapping
from typing import Any

from savmap.sim.scene import Scene


def site_of(scene: Scene, known: Mapping[str, Any]) -> dict[str, Any]:
    """The content of site.yaml for footage.mp4: every mapped row of the scene with its references (`known`, as in
    references.json)."""
    return {
        "plugins": {name: {} for name in scene.structures},
        "survey": "survey.json",
        "references": {"camera_height_m": known["camera_height_m"], "travel_m": known["camera_travel_m"]["value"]},
        "rows": {name: _row(scene, name, known[f"row_{name}"]) for name in scene.rows if f"row_{name}" in known},
    }


def _row(scene: Scene, name: str, known: Mapping[str, Any]) -> dict[str, Any]:
    forwards = scene.cart.end[0] > scene.cart.start[0]
    side = "left" if forwards == (scene.rows[name].facing == "+z") else "right"
    lowest = known["lowest_beam_bottom_height_m"]
    length = known["first_to_last_upright_outer_edges_m"]
    last = f"upright {len(lowest['values']) + 1} / right"
    row: dict[str, Any] = {
        "passes": [{"video": "footage.mp4", "side": side}],
        "references": {"lengths": [{"between": ["upright 1 / left", last], **length}]},
    }
    if all(value is not None for value in lowest["values"]):
        row["plugins"] = {"shelves": {"lowest_beam_bottom_height_m": lowest}}
    return row
