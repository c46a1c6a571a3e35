"""What is true about simulated footage, as files: the rig's path, and what a user would know without mapping."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from savmap.sim.build import Built
from savmap.sim.camera import Drive


def references(built: Built, path: Drive) -> dict[str, Any]:
    """Camera height, rough travel, and a few lengths of each mapped row, with their sigmas."""
    height = round(float(path.origins[:, 1].mean()), 3)
    travel = round(float(np.ptp(path.origins[:, 0])), 1)
    rows = {f"row_{name}": _row(entry) for name, entry in built.survey["rows"].items() if "uprights" in entry}
    return {
        "camera_height_m": {"value": height, "sigma": 0.02},
        "camera_travel_m": {"value": travel, "note": "roughly, from the start to the end of the clip"},
        **rows,
    }


def poses(built: Built, path: Drive) -> dict[str, Any]:
    """The rig's path as 4 by 4 matrices world_from_rig, and where each row's frame is in that world."""
    rows = {
        name: {"world_from_row": frame.world_from_row.tolist(), "origin": frame.origin.tolist()}
        for name, frame in built.frames.items()
    }
    matrices = np.tile(np.eye(4), (len(path.origins), 1, 1))
    matrices[:, :3, :3], matrices[:, :3, 3] = path.world_from_rig, path.origins
    frames = [
        {"frame": index, "stamp_s": float(stamp), "world_from_rig": matrix.tolist()}
        for index, (stamp, matrix) in enumerate(zip(path.stamps_s, matrices, strict=True))
    ]
    return {"format": "savmap-poses", "version": 1, "units": "m", "rows": rows, "frames": frames}


def _row(entry: Mapping[str, Any]) -> dict[str, Any]:
    lowest = [section["beams"][0][0] if section["beams"] else None for section in entry["sections"]]
    length = entry["uprights"][-1][1] - entry["uprights"][0][0]
    return {
        "lowest_beam_bottom_height_m": {"values": lowest, "sigma": 0.002},
        "first_to_last_upright_outer_edges_m": {"value": round(length, 4), "sigma": 0.003},
    }
