"""MCAP for Foxglove: JSON messages of its published schemas (foxglove.SceneUpdate, foxglove.PosesInFrame)."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from scipy.spatial.transform import Rotation

from savmap.maps.exports import require_library
from savmap.maps.exports.frames import Element, elements
from savmap.maps.exports.trajectories.drawn import FRAME, LINE_M, NANO, Colour, coloured, segments, texts, title
from savmap.maps.exports.trajectories.passes import PassFrames, passes
from savmap.types import Floats, SiteMap

LINE_LIST = 2
NEVER = {"sec": 0, "nsec": 0}
NO_TURN = {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}
OBJECT = {"type": "object"}
SCHEMAS = {
    "foxglove.SceneUpdate": {
        "deletions": {"type": "array", "items": OBJECT},
        "entities": {"type": "array", "items": OBJECT},
    },
    "foxglove.PosesInFrame": {
        "timestamp": OBJECT,
        "frame_id": {"type": "string"},
        "poses": {"type": "array", "items": OBJECT},
    },
}


def write_mcap(site: SiteMap, path: Path) -> None:
    """MCAP with `/map` (an entity for each structure, its attributes and standard deviations as metadata) and, for each
    pass, `/drive/ROW/PASS`. Needs the extra `ros`."""
    require_library("mcap", "ros")
    from mcap.writer import Writer

    entities = [_entity(element, colour) for element, colour in coloured(elements(site))]
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start(profile="", library="savmap")
        _send(writer, "/map", "foxglove.SceneUpdate", {"deletions": [], "entities": entities})
        for each in passes(site):
            _send(writer, f"/drive/{each.folder}", "foxglove.PosesInFrame", _drive(each))
        writer.finish()


def _send(writer: Any, topic: str, schema: str, message: object) -> None:
    shape = {"title": schema, "type": "object", "properties": SCHEMAS[schema]}
    number = writer.register_schema(schema, "jsonschema", json.dumps(shape).encode())
    channel = writer.register_channel(topic, "json", number)
    writer.add_message(channel, 0, json.dumps(message).encode(), 0)


def _entity(element: Element, colour: Colour) -> dict[str, Any]:
    ends = segments(element.structure)
    paint = dict(zip("rgb", (value / 255 for value in colour), strict=True)) | {"a": 1.0}
    line = {
        "type": LINE_LIST,
        "pose": {"position": _point([0.0, 0, 0]), "orientation": NO_TURN},
        "thickness": LINE_M,
        "scale_invariant": False,
        "points": [_point(end) for end in ends.reshape(-1, 3)],
        "color": paint,
        "colors": [],
        "indices": [],
    }
    text = {
        "pose": {"position": _point(element.structure.vertices.mean(axis=0)), "orientation": NO_TURN},
        "billboard": True,
        "font_size": 0.1,
        "scale_invariant": False,
        "color": paint,
        "text": title(element),
    }
    return {
        "timestamp": NEVER,
        "frame_id": FRAME,
        "id": f"{element.row}/{element.plugin}/{element.structure.id}",
        "lifetime": NEVER,
        "frame_locked": True,
        "metadata": [{"key": key, "value": value} for key, value in texts(element).items()],
        **{kind: [] for kind in ("arrows", "cubes", "spheres", "cylinders", "triangles", "models")},
        "lines": [line],
        "texts": [text],
    }


def _drive(each: PassFrames) -> dict[str, Any]:
    quaternions = Rotation.from_matrix(each.world_from_rig[:, :3, :3]).as_quat(canonical=True)
    poses = [
        {"position": _point(place), "orientation": dict(zip("xyzw", turn, strict=True))}
        for place, turn in zip(each.world_from_rig[:, :3, 3], quaternions.tolist(), strict=True)
    ]
    first = round(NANO * float(each.stamps_s[0]))
    return {"timestamp": {"sec": first // NANO, "nsec": first % NANO}, "frame_id": FRAME, "poses": poses}


def _point(place: Floats | Sequence[float]) -> dict[str, float]:
    return dict(zip("xyz", map(float, place), strict=True))
