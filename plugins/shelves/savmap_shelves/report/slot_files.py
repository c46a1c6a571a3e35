"""Slots and elements as files: CSV for spreadsheets and warehouse systems, JSON with a published schema
(docs/slots.schema.json)."""

import csv
import io
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field

from savmap.files.atomic import write_text
from savmap.files.texts import json_visible
from savmap.maps.exports.marks import BETWEEN
from savmap.maps.exports.vertices import cell
from savmap.types import Bools, Measured, SiteMap, Structure
from savmap_shelves.report.slots import Slot, edge, slots_of

FORMAT, VERSION = "savmap-slots", 1
DIALECT = "https://json-schema.org/draft/2020-12/schema"
LENGTH, SIGMA = 4, 5
"""Decimals."""
Sigma = Annotated[float, Field(ge=0)]
Vector = tuple[float, float, float]
Deviations = tuple[Sigma, Sigma, Sigma]


class _Part(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, use_attribute_docstrings=True, allow_inf_nan=False)


class SlotEntry(_Part):
    """An opening of a row's face: between two uprights, on a beam or on the floor."""

    row: str
    """The row's name in the map."""
    frame: Literal["world", "row"]
    """Of the centre: the world's, or the row's own turned z up, where the map does not say how its rows lie to one
    another."""
    bay: Annotated[int, Field(ge=0)]
    """The bay of the row, from 1, from left to right as one faces it."""
    level: Annotated[int, Field(ge=0)]
    """0 on the floor, 1 on the lowest beam, and so on."""
    signs: tuple[str, ...]
    """Texts of the signs at this level, from left to right, as they were read."""
    bay_signs: tuple[str, ...]
    """Texts of the signs on the bay's upright."""
    centre_m: Vector
    """x, y, z (up) of the opening's centre in the face; on the load level where it is open above."""
    sigma_centre_m: Deviations
    """Standard deviations of the centre."""
    clear_width_m: float | None
    """Between the uprights' inner edges; null where one of them was not mapped."""
    sigma_clear_width_m: Sigma | None
    """Its standard deviation."""
    clear_height_m: float | None
    """From the load level to the lower edge of the beam above; null where there is none: open above."""
    sigma_clear_height_m: Sigma | None
    """Its standard deviation."""
    load_height_m: float
    """The upper edge of the beam that goods stand on above the floor, or 0."""
    sigma_load_height_m: Sigma
    """Its standard deviation."""
    unchecked_m: Sigma | None = None
    """How far the uprights and beams around the opening may be off before a second reference shows it; null where it
    is next to nothing. No standard deviation holds it. Sizes are off by less."""
    depth_m: Annotated[float, Field(gt=0)]
    """From the face to the back."""
    depth: Literal["given", "assumed"]
    """Whether the depth was given in the site file, or assumed to be the usual."""
    assumed: tuple[Literal["clear height", "load height", "depth"], ...]
    """Which of these lengths nothing measured: the plugin takes them to be the usual."""
    warnings: tuple[str, ...]
    """What speaks against the uprights and beams around the opening, by the row's verdict: look before its sizes are
    used."""


class SlotFile(_Part):
    """The openings of a map's rows: where goods stand. Metres."""

    format: Literal["savmap-slots"]
    version: Literal[1]
    units: Literal["m"]
    slots: list[SlotEntry]


COLUMNS = [
    *("row", "frame", "bay", "level", "sign", "bay_sign"),
    *("x_m", "y_m", "z_m", "sigma_x_m", "sigma_y_m", "sigma_z_m"),
    *("clear_width_m", "sigma_clear_width_m", "clear_height_m", "sigma_clear_height_m"),
    *("load_height_m", "sigma_load_height_m", "unchecked_m", "depth_m", "depth", "assumed", "warnings"),
]


def write_csv(site: SiteMap, path: Path, plugin: str) -> None:
    """A line for each slot; an empty cell for what is not known, or does not end. Raises OutputError."""
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow(COLUMNS)
    table.writerows(_cells(slot) for slot in slots_of(site, plugin))
    write_text(path, text.getvalue())


def write_json(site: SiteMap, path: Path, plugin: str) -> None:
    """The slots as the schema says. Raises OutputError."""
    slots = [_entry(slot) for slot in slots_of(site, plugin)]
    content = {"format": FORMAT, "version": VERSION, "units": "m", "slots": slots}
    write_text(path, json_visible(json.dumps(content, indent=1, allow_nan=False, ensure_ascii=False)) + "\n")


def schema_text() -> str:
    """The JSON Schema of a file of slots."""
    schema = {"$schema": DIALECT, **SlotFile.model_json_schema(), "title": "savmap slots"}
    return json.dumps(schema, indent=2, sort_keys=True) + "\n"


def _entry(slot: Slot) -> dict[str, Any]:
    sigmas = slot.covariance.diagonal().clip(min=0.0) ** 0.5
    return {
        "row": slot.row,
        "frame": slot.frame,
        "bay": slot.bay,
        "level": slot.level,
        "signs": list(slot.signs),
        "bay_signs": list(slot.bay_signs),
        "centre_m": [_rounded(value, LENGTH) for value in slot.centre.tolist()],
        "sigma_centre_m": [_rounded(value, SIGMA) for value in sigmas.tolist()],
        **_measured("clear_width", slot.clear_width),
        **_measured("clear_height", slot.clear_height),
        **_measured("load_height", slot.load_height),
        "unchecked_m": slot.unchecked_m,
        "depth_m": _rounded(slot.depth_m, LENGTH),
        "depth": "assumed" if slot.depth_assumed else "given",
        "assumed": list(slot.assumed),
        "warnings": list(slot.warnings),
    }


def _measured(name: str, size: Measured | None) -> dict[str, float | None]:
    value = None if size is None else _rounded(size.value, LENGTH)
    return {f"{name}_m": value, f"sigma_{name}_m": None if size is None else _rounded(size.sigma, SIGMA)}


def _rounded(value: float, decimals: int) -> float:
    return round(value, decimals) + 0.0


def _cells(slot: Slot) -> list[str]:
    entry = _entry(slot)
    texts = {"sign": entry.pop("signs"), "bay_sign": entry.pop("bay_signs")}
    texts |= {key: entry.pop(key) for key in ("assumed", "warnings")}
    axes = zip("xyz", entry.pop("centre_m"), entry.pop("sigma_centre_m"), strict=True)
    entry |= {key: value for axis, at, sigma in axes for key, value in ((f"{axis}_m", at), (f"sigma_{axis}_m", sigma))}
    entry |= {key: BETWEEN.join(several) for key, several in texts.items()}
    return [_cell(name, entry[name]) for name in COLUMNS]


def _cell(name: str, value: str | float | None) -> str:
    if isinstance(value, float):
        return f"{value:.{SIGMA if name.startswith('sigma') else LENGTH}f}"
    return "" if value is None else cell(value) if isinstance(value, str) else str(value)


SIDES = ("left", "right", "bottom", "top")
SIZES = ("width", "height")
ELEMENT_COLUMNS = [
    *("row", "element", "label", "bay", "number"),
    *(f"{side}_m" for side in SIDES),
    *(f"sigma_{side}_m" for side in SIDES),
    *(name for size in SIZES for name in (f"{size}_m", f"sigma_{size}_m")),
    *("unchecked_m", "assumed", "warnings"),
]
ON_BEAMS = {"bottom": "lower", "top": "upper"}
"""What beams call these sides."""


def write_elements(site: SiteMap, path: Path, plugin: str) -> None:
    """A line for each upright and beam: its sides along the row and above the floor, in the row's frame, and its sizes,
    m. An empty cell for what an element has not, such as an upright a bay. `unchecked_m`: how far it may be off before
    a second reference shows it; `assumed`: the sides that nothing measured. Raises OutputError."""
    text, said = io.StringIO(), site.warnings()
    table = csv.writer(text, lineterminator="\n")
    table.writerow(ELEMENT_COLUMNS)
    for row in site.rows.values():
        for element in row.structures.get(plugin, ()):
            assumed = element.assumed(plugin, row.joint)
            table.writerow(_element_cells(row.name, element, assumed, said.get((row.name, element.id), ())))
    write_text(path, text.getvalue())


def _element_cells(row: str, element: Structure, assumed: Bools, against: Sequence[str]) -> list[str]:
    attributes = element.attributes
    names = [ON_BEAMS.get(side, side) if element.label == "beam" else side for side in SIDES]
    sides = [edge(element, number // 2, name) for number, name in enumerate(names)]
    unmeasured = [
        side
        for number, (side, name) in enumerate(zip(SIDES, names, strict=True))
        if any(
            axes[number // 2]
            for axes, label in zip(assumed, element.vertex_labels, strict=True)
            if name in label.split()
        )
    ]
    sizes = {name: (value, sigma) for name, value, sigma in element.sizes()}
    return [
        *map(cell, (row, element.id, element.label)),
        *(str(attributes.get(key, "")) for key in ("bay", element.label)),
        *(f"{side.value:.4f}" for side in sides),
        *(f"{side.sigma:.5f}" for side in sides),
        *(
            text
            for size in SIZES
            for text in ((f"{value:.5f}" for value in sizes[size]) if size in sizes else ("", ""))
        ),
        "" if element.unchecked_m is None else f"{element.unchecked_m:.3f}",
        cell(BETWEEN.join(unmeasured)),
        cell(BETWEEN.join(against)),
    ]
