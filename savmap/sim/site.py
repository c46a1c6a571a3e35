"""A site file for simulated footage: what a user who had driven there would write."""

from collections.abc import Mapping, Sequence
from typing import Any

from savmap.sim.passes import TruePass
from savmap.sim.scene import Scene


def site_of(scene: Scene, known: Mapping[str, Any], passes: Sequence[TruePass] = ()) -> dict[str, Any]:
    """The content of site.yaml for footage.mp4: every mapped row of the scene with its references (`known`, as in
    references.json). Along a path the rows have the time ranges of `passes`, and those that it never passes are left out."""
    return {
        "plugins": {name: {} for name in scene.structures},
        "survey": "survey.json",
        "references": {"camera_height_m": known["camera_height_m"], "travel_m": known["camera_travel_m"]["value"]},
        "rows": {
            name: _row(one, known.get(f"row_{name}", {}))
            for name, one in _drives(scene, passes).items()
            if scene.rows[name].mapped
        },
    }


def _drives(scene: Scene, passes: Sequence[TruePass]) -> dict[str, list[dict[str, Any]]]:
    """The passes of each row, as a site file has them."""
    if scene.cart.path is None:
        return {name: [{"video": "footage.mp4", "side": _side(scene, name)}] for name in scene.rows}
    drives: dict[str, list[dict[str, Any]]] = {}
    for one in passes:
        span = {"video": "footage.mp4", "start_s": round(one.start_s, 2), "end_s": round(one.end_s, 2)}
        for name in (*one.left, *one.right):
            drives.setdefault(name, []).append({**span, "side": "left" if name in one.left else "right"})
    return drives


def _side(scene: Scene, name: str) -> str:
    forwards = scene.cart.end[0] > scene.cart.start[0]
    return "left" if forwards == (scene.rows[name].facing == "+z") else "right"


def _row(passes: Sequence[Mapping[str, Any]], known: Mapping[str, Any]) -> dict[str, Any]:
    if not known:
        return {"passes": list(passes)}
    lowest = known["lowest_beam_bottom_height_m"]
    length = known["first_to_last_upright_outer_edges_m"]
    last = f"upright {len(lowest['values']) + 1} / right"
    row: dict[str, Any] = {
        "passes": list(passes),
        "references": {"lengths": [{"between": ["upright 1 / left", last], **length}]},
    }
    if all(value is not None for value in lowest["values"]):
        row["plugins"] = {"shelves": {"lowest_beam_bottom_height_m": lowest}}
    return row
