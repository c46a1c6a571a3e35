"""IMDF 1.0 (Indoor Mapping Data Format): an archive with a venue, its building and level, and a fixture for each solid.

What IMDF asks for and a map does not know is marked to be filled in: the postal address, names, and the walls of the
building, whose outline here is that of what was mapped.
"""

import hashlib
import uuid
from pathlib import Path
from typing import Any

import numpy as np

from savmap.errors import OutputError
from savmap.maps.exports.files import json_text, timestamp, write_archive
from savmap.maps.exports.frames import elements
from savmap.maps.exports.hull import hull
from savmap.maps.exports.plans.footprints import Footprint, footprints
from savmap.maps.exports.plans.geojson import Earth, ring
from savmap.maps.exports.plans.routes import route_graph
from savmap.types import Floats, SiteMap

VERSION, LANGUAGE = "1.0.0", "en"
MARGIN_M = 1.0
ADDRESS = ("address", "unit", "locality", "province", "country", "postal_code", "postal_code_ext", "postal_code_vanity")
UNKNOWN, NOWHERE = "to be filled in", "ZZ"
"""Texts, and a country: ISO 3166 leaves ZZ to who needs a country that is not known."""


def write_imdf(site: SiteMap, path: Path) -> None:
    """A .zip with manifest.json and a GeoJSON file for each type of feature. Raises OutputError, also for a site
    without an anchor."""
    earth = Earth(site)
    solids = footprints(elements(site))
    if not solids:
        raise OutputError("the map holds no solids, which are what fixtures are made of")
    ground = hull(np.vstack([*(footprint.outline for footprint in solids), route_graph(site).nodes]), MARGIN_M)
    manifest = {
        "version": VERSION,
        "created": timestamp().replace(".00Z", "+00:00"),
        "generated_by": f"savmap {site.made_by.get('savmap', '')}".strip(),
        "language": LANGUAGE,
        "extensions": None,
    }
    kinds = {**_envelope(earth, ground), "fixture": [_fixture(earth, footprint) for footprint in solids]}
    collections = {
        f"{kind}.geojson": json_text({"type": "FeatureCollection", "name": kind, "features": features})
        for kind, features in kinds.items()
    }
    write_archive(path, {"manifest.json": json_text(manifest), **collections})


def _envelope(earth: Earth, ground: Floats) -> dict[str, list[dict[str, Any]]]:
    """The features around the fixtures: address, venue, building, footprint and level, of which all have the same
    outline."""
    area = {"type": "Polygon", "coordinates": [ring(earth, ground)]}
    middle = {"type": "Point", "coordinates": earth.positions(ground.mean(axis=0)[None])[0]}
    named = {"restriction": None, "name": _labels("savmap"), "alt_name": None, "display_point": middle}
    address = dict.fromkeys(ADDRESS) | {"address": UNKNOWN, "locality": UNKNOWN, "country": NOWHERE}
    venue = {"category": "businesscampus", **named, "hours": None, "phone": None, "website": None}
    building = {"category": "unspecified", **named, "address_id": feature_id("address")}
    outline = {"category": "ground", "name": None, "building_ids": [feature_id("building")]}
    level = {
        "category": "unspecified",
        "restriction": None,
        "outdoor": False,
        "ordinal": 0,
        "name": _labels("Ground floor"),
        "short_name": _labels("0"),
        "display_point": middle,
        "address_id": None,
        "building_ids": [feature_id("building")],
    }
    return {
        "address": [_feature("address", None, address)],
        "venue": [_feature("venue", area, {**venue, "address_id": feature_id("address")})],
        "building": [_feature("building", None, building)],
        "footprint": [_feature("footprint", area, outline)],
        "level": [_feature("level", area, level)],
    }


def _fixture(earth: Earth, footprint: Footprint) -> dict[str, Any]:
    properties = {
        "category": "equipment",
        "name": _labels(footprint.name),
        "alt_name": None,
        "anchor_id": None,
        "level_id": feature_id("level"),
        "display_point": {"type": "Point", "coordinates": earth.positions(footprint.outline.mean(axis=0)[None])[0]},
    }
    area = {"type": "Polygon", "coordinates": [ring(earth, footprint.outline)]}
    return _feature("fixture", area, properties, footprint.name)


def feature_id(kind: str, name: str = "") -> str:
    """A UUID of version 4, as IMDF wants it, that is the same for the same feature."""
    digest = hashlib.sha256(f"savmap {kind} {name}".encode("utf-8", "replace")).digest()
    return str(uuid.UUID(bytes=digest[:16], version=4))


def _feature(kind: str, geometry: Any, properties: dict[str, Any], name: str = "") -> dict[str, Any]:
    head = {"id": feature_id(kind, name), "type": "Feature", "feature_type": kind}
    return {**head, "geometry": geometry, "properties": properties}


def _labels(text: str) -> dict[str, str]:
    return {LANGUAGE: text}
