"""Elements of a drawing, DXF, by the library `ezdxf`: what lies on layers that are called like a label, or that the
options give one.

Each block that is inserted, closed line, mesh and point is an element; lines that touch one another on a layer are one.
A drawing that savmap wrote says in its extended data what each line is of. Of curves only the corners count.
"""

import io
import logging
import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from savmap.errors import OutputError, format_error
from savmap.files.texts import MOST_MB
from savmap.maps.exports import require_library
from savmap.maps.imports.records import MOST_POINTS, UNITS, ImportOptions, SurveyElement, bytes_of, element, listed
from savmap.types import Floats, array_record

MOST_ENTITIES, DEEPEST_BLOCK = 200_000, 12
"""Of a drawing whose blocks are inserted, each as often as it is; and of blocks within blocks."""
INSERTED = 10
"""Entities that a block being inserted counts as: it takes so much longer."""
FARTHEST = 1e10
"""Of a corner, in any unit."""
SAVMAP = "SAVMAP"
"""The application whose extended data savmap's drawings hold."""
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
    line that others go on from, and what a drawing of savmap's says of it (row, plugin, id, label and what is written
    on it)."""

    layer: str
    name: str
    corners: Floats
    open: bool
    tags: tuple[str, ...] = ()


def read_drawing(path: Path, options: ImportOptions, labels: Mapping[str, str]) -> list[SurveyElement]:
    """The elements of a drawing. `labels`: those of the plugins, by themselves in lower case. Raises OutputError."""
    content = bytes_of(path, MOST_MB)
    if content.startswith(DWG):
        raise OutputError(f"{path}: is a DWG drawing, which is not read: save it as DXF")
    if content.startswith(BINARY):
        raise OutputError(f"{path}: is a binary DXF drawing, which is not read: save it as DXF in text (ASCII)")
    if not SECTION.search(content):  # the library takes it for a drawing that is empty
        raise OutputError(f"{path}: is no DXF drawing")
    require_library("ezdxf", "cad")
    logger = logging.getLogger("ezdxf")  # what cannot be read is said once
    before, logger.disabled = logger.disabled, True
    try:
        pieces, number = _pieces(content)
    except OutputError as error:
        raise OutputError(f"{path}: {error}") from error
    except (Exception, SystemExit) as error:
        raise OutputError(f"{path}: is not a DXF that can be read ({listed([format_error(error)])})") from error
    finally:
        logger.disabled = before
    if options.unit is None and number not in DXF_UNITS:
        raise OutputError(
            f"{path}: says no unit of length that is read ($INSUNITS is {number}): say it, such as --unit mm"
        )
    metres = UNITS[options.unit or DXF_UNITS[number]]
    tagged = [piece for piece in pieces if piece.tags]
    if tagged and not options.labels:
        elements = _written_by_savmap(tagged, metres, options)
    else:
        elements = _drawn(path, pieces, metres, options, labels)
    if not elements:
        raise OutputError(f"{path}: nothing is drawn on its layers")
    return elements


def _pieces(content: bytes) -> tuple[list[Piece], int]:
    """The pieces of the model space, and $INSUNITS. Raises OutputError, and whatever the library does."""
    from ezdxf import recover

    document, _ = recover.read(io.BytesIO(content))
    pieces = [piece for piece in _inserted(document.modelspace(), _Budget()) if len(piece.corners)]
    if any(not (np.abs(piece.corners) < FARTHEST).all() for piece in pieces):
        raise OutputError("a corner in it is not finite, or too far away")
    return pieces, int(document.header.get("$INSUNITS", 0))


class _Budget:
    """How many entities, those of blocks as often as they are inserted, and corners may still be read."""

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
        name, layer = f"{entity.dxftype()} {entity.dxf.handle or ''}".strip(), str(entity.dxf.layer)
        tags: tuple[str, ...] = ()
        if entity.has_xdata(SAVMAP):
            texts = [str(value) for code, value in entity.get_xdata(SAVMAP) if code == 1000]
            tags = tuple(map(_undrawn, texts[:5])) if len(texts) >= 4 else ()
        if entity.dxftype() == "INSERT":
            for copy in _copies(entity):
                corners = np.concatenate([np.zeros((0, 3)), *_in_block(copy, budget, 1)])
                yield Piece(layer, name, corners, False, tags)
        elif entity.dxftype() not in TEXTS:
            corners, is_open = _corners(entity)
            budget.spend(1, len(corners))
            yield Piece(layer, name, corners, is_open, tags)


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
    kind, points, is_open = entity.dxftype(), [], False
    if kind == "LINE":
        points, is_open = [entity.dxf.start, entity.dxf.end], True
    elif kind == "POINT":
        points = [entity.dxf.location]
    elif kind == "LWPOLYLINE":
        points = list(entity.vertices_in_wcs())
        is_open = not entity.closed and len(points) < 3
    elif kind == "POLYLINE":
        points = [vertex.dxf.location for vertex in entity.vertices]
    elif kind in ("3DFACE", "SOLID", "TRACE"):
        points, is_open = entity.wcs_vertices(), kind == "3DFACE"
    elif kind == "MESH":
        points = list(entity.vertices)
    elif kind == "CIRCLE":
        points = list(entity.vertices((0, 90, 180, 270)))
    return np.array([tuple(point)[:3] for point in points], dtype=np.float64).reshape(-1, 3), is_open


def _undrawn(text: str) -> str:
    """A text whose codes of drawings stand for what they mean (`exports.models.dxf.drawn_text`)."""
    return text.replace("%%%%%%", "%%").replace("^ ", "^")


def _written_by_savmap(pieces: Sequence[Piece], metres: float, options: ImportOptions) -> list[SurveyElement]:
    """The structures of a drawing that savmap wrote, which stand in the world."""
    groups = dict[tuple[str, ...], list[Piece]]()
    for piece in pieces:
        groups.setdefault(piece.tags[:4], []).append(piece)
    elements = []
    for (row, _, name, label), group in groups.items():
        text = "".join(group[0].tags[4:])
        structure = element(name, label, _corners_of(group) * metres, attributes={"text": text} if text else {})
        elements.append(SurveyElement(row, options.frame or "world", structure))
    return elements


def _corners_of(pieces: Sequence[Piece]) -> Floats:
    """The corners of pieces, each once, in their order."""
    corners = np.concatenate([piece.corners for piece in pieces])
    _, first = np.unique(np.round(corners, SAME_DIGITS), axis=0, return_index=True)
    return corners[np.sort(first)]


def _drawn(
    path: Path, pieces: Sequence[Piece], metres: float, options: ImportOptions, labels: Mapping[str, str]
) -> list[SurveyElement]:
    """The elements on layers that have a label."""
    given = {theirs.casefold(): ours for theirs, ours in options.labels.items()} or labels
    chosen = [piece for piece in pieces if piece.layer.casefold() in given]
    if not chosen:
        layers = [layer for layer, _ in Counter(piece.layer for piece in pieces).most_common()]
        raise OutputError(
            f"{path}: no layer is called like a label ({listed(labels.values())}); there are {listed(layers)}: "
            "say --layer NAME=LABEL"
        )
    groups = [[piece] for piece in chosen if not piece.open]
    groups += _touching([piece for piece in chosen if piece.open], metres)
    elements = []
    for group in groups:
        name, layer = group[0].name, group[0].layer
        structure = element(f"{name} on layer {layer}", given[layer.casefold()], _corners_of(group) * metres)
        elements.append(SurveyElement("", options.usual_frame, structure))
    return elements


def _touching(pieces: Sequence[Piece], metres: float) -> list[list[Piece]]:
    """Lines of a layer that touch one another, in groups: they have a cell of a millimetre in common, in which a corner
    is, or nearly is."""
    first = dict[tuple[object, ...], int]()
    links = [(k, k) for k in range(len(pieces))]
    for k, piece in enumerate(pieces):
        for corner in piece.corners * metres:
            ends = [np.floor((corner + shift) / TOUCH_M).astype(np.int64).tolist() for shift in (-NEARLY_M, NEARLY_M)]
            cells = product(*({low, high} for low, high in zip(*ends, strict=True)))
            links += [(k, first.setdefault((piece.layer, cell), k)) for cell in cells]
    if not pieces:
        return []
    graph = coo_matrix((np.ones(len(links)), np.array(links).T), shape=(len(pieces),) * 2)
    _, numbers = connected_components(graph, directed=False)
    groups = dict[int, list[Piece]]()
    for piece, number in zip(pieces, numbers.tolist(), strict=True):
        groups.setdefault(number, []).append(piece)
    return list(groups.values())
