"""A zone set of VDA 5050 3.0: a blocked zone for each solid that stands in the way."""

import hashlib
import json
from pathlib import Path
from typing import Any

import numpy as np

from savmap.errors import OutputError
from savmap.files.atomic import write_text
from savmap.maps.exports.frames import elements
from savmap.maps.exports.json_text import json_text, timestamp
from savmap.maps.exports.plans.footprints import Footprint, depth_note, footprints, in_the_way
from savmap.types import SiteMap

VERSION = "3.0.0"
MAP = "map"
DECIMALS = 4


def write_zone_set(site: SiteMap, path: Path) -> None:
    """The message of the topic zoneSet; its header's serial number is left to who sends it. Raises OutputError."""
    floor = site.alignment.z_m if site.alignment else 0.0
    found = in_the_way(footprints(elements(site)), floor)
    if not found:
        raise OutputError("nothing in this map stands in the way: it has no solids near the floor")
    zones = [_zone(footprint) for footprint in found]
    digest = hashlib.sha256(json.dumps(zones).encode("utf-8", "replace")).hexdigest()
    zone_set = {
        "mapId": MAP,
        "zoneSetId": f"savmap-{digest[:12]}",
        "zoneSetDescriptor": "; ".join(filter(None, ("solids that stand in the way of vehicles", depth_note(found)))),
        "zones": zones,
    }
    header = {
        "headerId": 0,
        "timestamp": timestamp(),
        "version": VERSION,
        "manufacturer": "savmap",
        "serialNumber": "",
    }
    write_text(path, json_text({**header, "zoneSet": zone_set}))


def _zone(footprint: Footprint) -> dict[str, Any]:
    corners = (np.round(footprint.outline, DECIMALS) + 0.0).tolist()
    return {
        "zoneId": footprint.name,
        "zoneType": "BLOCKED",
        "zoneDescriptor": f"{footprint.label} of row {footprint.row}{', depth assumed' if footprint.assumed else ''}",
        "vertices": [{"x": x, "y": y} for x, y in corners],
    }
