"""Elements of a drawing, DXF, by the library `ezdxf`: what lies on layers that are called like a label, or that the
options give one.

Each block that is inserted, closed line, mesh and point is an element; lines that touch one another on a layer are one.
A drawing of savmap's own says in its extended data what each line is of. Curves count with their corners alone.
"""

import io
import logging
import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from savmap.errors import OutputError, format_error
from savmap.files.atomic import reason
from savmap.files.texts import MOST_MB, bounded_bytes
from savmap.maps.exports import require_library
from savmap.maps.imports.records import MOST_POINTS, UNITS, Found, ImportOptions, element, listed
from savmap.types import Floats, array_record

MOST_ENTITIES, DEEPEST_BLOCK = 200_000, 12
"""Of a drawing whose blocks are inserted, each as often as it is; and of blocks within blocks."""
INSERTED = 10
"""Entities that a block being inserted counts as: it takes so much longer."""
FARTHEST = 1e10
"""Of a corner, in any unit."""
OWN = "SAVMAP"
"""The application whose extended data savmap's own drawings hold."""
DXF_UNITS: Mapping[int, str] = {1: "in", 2: "ft", 4: "mm", 5: "cm", 6: "m", 14: "dm"}
"""Of $INSUNITS."""
BINARY, DWG = b"AutoCAD Binary DXF", (b"AC10", b"AC1.", b"AC2.1")
"""How other files of CAD programs begin: DXF that is no text, and DWG."""
SECTION = re.compile(rb"^[ \t]*0[ \t]*\r?\n[ \t]*SECTION[ \t]*\r?$", re.MULTILINE)
TOUCH_M, NEARLY_M = 1e-3, 1e-5
SAME_DIGITS = 6
TEXTS = frozenset({"TEXT", "MTEXT", "ATTDEF", "ATTRIB", "DIMENSION", "LEADER", "MULTILEADER", "VIEWPORT", "HATCH"})
"""What is no element, and is not missed."""


@dataclass(frozen=True, eq=False)
@array_record
class Piece:
    """One entity, blocks inserted: its layer, what it is called, corners (n, 3) in the drawing's unit, whether it is a
    line that others go on from, and what savmap's own drawing says of it (row, plugin, id, label and what is written on
    it)."""

    layer: str
    name: str
    corners: Floats
    open: bool
    own: tuple[str, ...] = ()


def read_drawing(path: Path, options: ImportOptions, labels: Mapping[str, str]) -> list[Found]:
    """The elements of a drawing. `labels`: those of the plugins, by themselves in lower case. Raises OutputError."""
    require_library("ezdxf", "cad")
    try:
        content = bounded_bytes(path, MOST_MB)
    except OSError as error:
        raise OutputError(f"{path}: cannot be read ({reason(error)})") from error
    except ValueError as error:
        raise OutputError(f"{path}: {error}") from error
    _require_drawing(path, content)
    try:
        with _quiet():
            pieces, number = _pieces(content)
    except OutputError as error:
        raise OutputError(f"{path}: {error}") from error
    except (Exception, SystemExit) as error:
        raise OutputError(f"{path}: is not a DXF that can be read ({listed([format_error(error)])})") from error
    metres = _metres(path, options, number)
    own = [piece for piece in pieces if piece.own]
    found = _own(own, metres, options) if own and not options.labels else _drawn(path, pieces, metres, options, labels)
    if not found:
        raise OutputError(f"{path}: nothing is drawn on its layers")
    return found


def _require_drawing(path: Path, content: bytes) -> None:
    """Raise OutputError for what is no DXF in text: where it has not one section, the library takes it for a drawing
    that is empty."""
    if content.startswith(DWG):
        raise OutputError(f"{path}: is a DWG drawing, which is not read: save it as DXF")
    if content.startswith(BINARY):
        raise OutputError(f"{path}: is a binary DXF drawing, which is not read: save it as DXF in text (ASCII)")
    if not SECTION.search(content):
        raise OutputError(f"{path}: is no DXF drawing")


@contextmanager
def _quiet() -> Iterator[None]:
    """The library's own notices are left out: what cannot be read is said once."""
    logger = logging.getLogger("ezdxf")
    before = logger.disabled
    logger.disabled = True
    try:
        yield
    finally:
        logger.disabled = before


def _pieces(content: bytes) -> tuple[list[Piece], int]:
    """The pieces of the model space, and $INSUNITS. Raises OutputError, and whatever the library does."""
    from ezdxf import recover

    document, _ = recover.read(io.BytesIO(content))
    pieces = [piece for piece in _inserted(document.modelspace(), _Budget()) if len(piece.corners)]
    if any(not (np.abs(piece.corners) < FARTHEST).all() for piece in pieces):
        raise OutputError("a corner in it is not finite, or too far away")
    return pieces, int(document.header.get("$INSUNITS", 0))


class _Budget:
    """How many entities, those of blocks as often as they are inserted, and corners may still be looked at."""

    def __init__(self) -> None:
        self.entities, self.corners = MOST_ENTITIES, MOST_POINTS

    def spend(self, entities: int, corners: int = 0) -> None:
        self.entities -= entities
        self.corners -= corners
        if self.entities < 0 or self.corners < 0:
            raise OutputError(
                f"it holds more than {MOST_ENTITIES} entities or {MOST_POINTS} corners, which is the most that is read"
            )


def _inserted(entities: Any, budget: _Budget) -> Iterator[Piece]:
    """The entities as pieces; a block that is inserted is one, on the layer on which it is."""
    for entity in entities:
        if entity.dxftype() == "INSERT":
            for copy in _copies(entity):
                whole = np.concatenate([np.zeros((0, 3)), *_in_block(copy, budget, 1)])
                yield Piece(str(entity.dxf.layer), _name(entity), whole, False, _said(entity))
        elif entity.dxftype() not in TEXTS:
            corners, is_open = _corners(entity)
            budget.spend(1, len(corners))
            yield Piece(str(entity.dxf.layer), _name(entity), corners, is_open, _said(entity))


def _copies(insert: Any) -> Iterator[Any]:
    """A block as often as it is inserted: in columns and rows, or once."""
    return insert.multi_insert() if insert.mcount > 1 else iter((insert,))


def _in_block(insert: Any, budget: _Budget, depth: int) -> Iterator[Floats]:
    """The corners of a block that is inserted, and of those in it."""
    budget.spend(INSERTED)
    if depth > DEEPEST_BLOCK:
        raise OutputError(f"blocks are within blocks more than {DEEPEST_BLOCK} deep")
    for entity in insert.virtual_entities():
        if entity.dxftype() == "INSERT":
            for copy in _copies(entity):
                yield from _in_block(copy, budget, depth + 1)
        elif entity.dxftype() not in TEXTS:
            corners, _ = _corners(entity)
            budget.spend(1, len(corners))
            yield corners


def _corners(entity: Any) -> tuple[Floats, bool]:
    """Corners (n, 3) of an entity in the world of the drawing, none of a kind that has none, and whether lines may go
    on from it."""
    kind = entity.dxftype()
    if kind == "LINE":
        return _array([entity.dxf.start, entity.dxf.end]), True
    if kind == "POINT":
        return _array([entity.dxf.location]), False
    if kind == "LWPOLYLINE":
        points = _array(list(entity.vertices_in_wcs()))
        return points, not entity.closed and len(points) < 3
    if kind == "POLYLINE":
        return _array([vertex.dxf.location for vertex in entity.vertices]), False
    if kind in ("3DFACE", "SOLID", "TRACE"):
        return _array(entity.wcs_vertices()), kind == "3DFACE"
    if kind == "MESH":
        return _array(list(entity.vertices)), False
    if kind == "CIRCLE":
        return _array(list(entity.vertices((0, 90, 180, 270)))), False
    return np.zeros((0, 3)), False


def _array(points: Sequence[Any]) -> Floats:
    return np.array([tuple(point)[:3] for point in points], dtype=np.float64).reshape(-1, 3)


def _name(entity: Any) -> str:
    """By what a CAD program finds the entity."""
    return f"{entity.dxftype()} {entity.dxf.handle or ''}".strip()


def _said(entity: Any) -> tuple[str, ...]:
    """What savmap's own drawing says of an entity: row, plugin, id, label, and what is written on it if anything is."""
    if not entity.has_xdata(OWN):
        return ()
    texts = [_plain(str(value)) for code, value in entity.get_xdata(OWN) if code == 1000]
    return tuple(texts[:5]) if len(texts) >= 4 else ()


def _plain(text: str) -> str:
    """A text whose codes of drawings stand for what they mean (`exports.models.dxf.drawn_text`)."""
    return text.replace("%%%%%%", "%%").replace("^ ", "^")


def _metres(path: Path, options: ImportOptions, number: int) -> float:
    """Metres of the drawing's unit. Raises OutputError where it has none, or a strange one."""
    if options.unit is not None:
        return UNITS[options.unit]
    if number not in DXF_UNITS:
        raise OutputError(
            f"{path}: says no unit of length that is read ($INSUNITS is {number}): say it, such as --unit mm"
        )
    return UNITS[DXF_UNITS[number]]


def _own(pieces: Sequence[Piece], metres: float, options: ImportOptions) -> list[Found]:
    """The structures of savmap's own drawing, which stand in the world."""
    groups = dict[tuple[str, ...], list[Piece]]()
    for piece in pieces:
        groups.setdefault(piece.own[:4], []).append(piece)
    return [
        Found(
            row,
            options.frame or "world",
            element(
                name, label, _once(own) * metres, attributes={"text": text} if (text := "".join(own[0].own[4:])) else {}
            ),
        )
        for (row, _, name, label), own in groups.items()
    ]


def _once(pieces: Sequence[Piece]) -> Floats:
    """The corners of pieces, each once, in their order."""
    corners = np.concatenate([piece.corners for piece in pieces])
    _, first = np.unique(np.round(corners, SAME_DIGITS), axis=0, return_index=True)
    return corners[np.sort(first)]


def _drawn(
    path: Path, pieces: Sequence[Piece], metres: float, options: ImportOptions, labels: Mapping[str, str]
) -> list[Found]:
    """The elements on layers that have a label."""
    given = {theirs.casefold(): ours for theirs, ours in options.labels.items()} or labels
    chosen = [piece for piece in pieces if piece.layer.casefold() in given]
    if not chosen:
        layers = [layer for layer, _ in Counter(piece.layer for piece in pieces).most_common()]
        raise OutputError(
            f"{path}: no layer is called like a label ({listed(labels.values())}); there are {listed(layers)}: "
            "say --layer NAME=LABEL"
        )
    closed = [[piece] for piece in chosen if not piece.open]
    groups = closed + _touching([piece for piece in chosen if piece.open], metres)
    return [
        Found(
            "",
            options.usual_frame,
            element(f"{own[0].name} on layer {own[0].layer}", given[own[0].layer.casefold()], _once(own) * metres),
        )
        for own in groups
    ]


def _touching(pieces: Sequence[Piece], metres: float) -> list[list[Piece]]:
    """Lines of a layer that touch one another, in groups."""
    group_of = list(range(len(pieces)))

    def root(k: int) -> int:
        while group_of[k] != k:
            group_of[k] = group_of[group_of[k]]
            k = group_of[k]
        return k

    at = dict[tuple[str, tuple[int, ...]], int]()
    for k, piece in enumerate(pieces):
        for corner in piece.corners * metres:
            for cell in _cells(corner):
                other = at.setdefault((piece.layer, cell), k)
                group_of[root(k)] = root(other)
    groups = dict[int, list[Piece]]()
    for k, piece in enumerate(pieces):
        groups.setdefault(root(k), []).append(piece)
    return list(groups.values())


def _cells(corner: Floats) -> set[tuple[int, ...]]:
    """The cells of a millimetre in which a corner is, or nearly is: two that are where they should be have one in
    common."""
    ends = [np.floor((corner + shift) / TOUCH_M).tolist() for shift in (-NEARLY_M, NEARLY_M)]
    return set(product(*({int(low), int(high)} for low, high in zip(*ends, strict=True))))
