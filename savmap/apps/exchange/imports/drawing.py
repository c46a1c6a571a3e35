"""Elements of a drawing, DXF, by the library `ezdxf`: what lies on layers that are called like a label, or that the
options give one.

Each block that is inserted, closed line, mesh and point is an element; lines that touch one another on a layer are one.
A drawing that savmap wrote says in its extended data what each line is of. What is hidden, or is of another kind, is
named.
"""

import io
import logging
import re
from collections import Counter
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from savmap.apps.exchange.imports.records import (
    MOST_POINTS,
    UNITS,
    FileElements,
    ImportOptions,
    SurveyElement,
    bytes_of,
    element,
    listed,
)
from savmap.errors import OutputError, format_error
from savmap.files.texts import MOST_MB
from savmap.maps.exports import require_library
from savmap.types import Floats, array_record

MOST_ENTITIES, DEEPEST_BLOCK = 200_000, 12
"""Of a drawing whose blocks are inserted, each as often as it is; and of blocks within blocks."""
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
TEXTS = frozenset({"TEXT", "MTEXT", "ATTDEF", "ATTRIB", "DIMENSION", "LEADER", "MULTILEADER", "VIEWPORT", "TOLERANCE"})
"""What is no element, and is not missed."""
CURVES = frozenset({"CIRCLE", "ARC", "ELLIPSE", "SPLINE", "HELIX"})
READ = CURVES | {"LINE", "3DFACE", "POINT", "LWPOLYLINE", "POLYLINE", "SOLID", "TRACE", "MESH", "MLINE"}
GONE = re.compile(r"Deleted |Removed [A-Z]+\(#")
"""What ezdxf says of an entity that it takes away."""
CONTROL_POINT = 16
"""Flag of a vertex of a fitted polyline that is not on it."""
CHORDS, FLAT = 32, 1e-6
"""Of a quarter of a circle; and how flat a curve is that has no width along an axis, for its size."""


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


def read_drawing(path: Path, options: ImportOptions, labels: Mapping[str, str]) -> FileElements:
    """The elements of a drawing, and a note on what is not read of its layers. `labels`: those of the plugins, by
    themselves in lower case. Raises OutputError."""
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
    given = {theirs.casefold(): ours for theirs, ours in options.labels.items()} or labels
    try:
        from ezdxf import recover

        document, audit = recover.read(io.BytesIO(content))
        number = int(document.header.get("$INSUNITS", 0))
        if options.unit is None and number not in DXF_UNITS:
            raise OutputError(f"says no unit of length that is read ($INSUNITS is {number}): say it, such as --unit mm")
        metres = UNITS[options.unit or DXF_UNITS[number]]
        drawing = _ModelSpace(document, given.keys())
        drawing.unread["damaged, or of a missing block"] += sum(bool(GONE.match(fix.message)) for fix in audit.fixes)
    except OutputError as error:
        raise OutputError(f"{path}: {error}") from error
    except (Exception, SystemExit) as error:
        raise OutputError(f"{path}: is not a DXF that can be read ({listed([format_error(error)])})") from error
    finally:
        logger.disabled = before
    unread = listed(f"{count} {what}" for what, count in (+drawing.unread).items())
    notes = (f"not read: {unread}",) if +drawing.unread else ()
    tagged = [piece for piece in drawing.pieces if piece.tags]
    if tagged and not options.labels:
        return FileElements(tuple(_written_by_savmap(tagged, metres, options)), notes)
    chosen = [piece for piece in drawing.pieces if piece.layer.casefold() in given]
    if not chosen:
        layers = [layer for layer, _ in drawing.layers.most_common()]
        why = f"no layer is called like a label ({listed(labels.values())}); there are {listed(layers)}"
        if given.keys() & map(str.casefold, layers):
            why = "nothing is drawn on its layers that is read"
        raise OutputError("; ".join((f"{path}: {why}: say --layer NAME=LABEL", *notes)))
    return FileElements(tuple(_drawn(chosen, metres, options, given)), notes)


class _ModelSpace:
    """What the model space of a drawing holds, blocks inserted. labelled: layers in lower case that have a label.
    `layers`: how many entities each layer has. `unread`: how often what was left out."""

    def __init__(self, document: Any, labelled: Collection[str]) -> None:
        from ezdxf.math import Matrix44

        self.document, self.labelled = document, labelled
        self.entities, self.corners = MOST_ENTITIES, MOST_POINTS
        self.layers, self.unread = Counter[str](), Counter[str]()
        self.pieces = list(self._read(document.modelspace(), Matrix44(), "", 0, False))
        for layout in document.layouts:
            for entity in layout if layout.is_any_paperspace else ():
                if entity.dxf.layer.casefold() in labelled and entity.dxftype() not in TEXTS:
                    self.unread[f"{entity.dxftype()} in paper space"] += 1
        if any(not (np.abs(piece.corners) < FARTHEST).all() for piece in self.pieces):
            raise OutputError("a corner in it is not finite, or too far away")

    def _read(self, entities: Any, matrix: Any, above: str, depth: int, whole: bool) -> Iterator[Piece]:
        """The entities of a layout or block as pieces, those of layers with a label, or `whole`, all. matrix: to the
        world's coordinates. above: the layer on which the block is inserted; what is on layer 0 in it is on that.
        What is in a block is shown where the layer of the block is off, but not where it is frozen."""
        for entity in entities:
            kind, layer = entity.dxftype(), str(entity.dxf.layer)
            layer = above if above and layer == "0" else layer
            tags: tuple[str, ...] = ()
            if entity.has_xdata(SAVMAP):
                texts = [str(value) for code, value in entity.get_xdata(SAVMAP) if code == 1000]
                tags = tuple(map(_undrawn, texts[:5])) if len(texts) >= 4 else ()
            wanted = whole or bool(tags) or layer.casefold() in self.labelled
            self._spend(int(depth > 0 or kind not in TEXTS))
            if kind in TEXTS:
                continue
            self.layers[layer] += 1
            entry = self.document.layers.get(layer) if layer in self.document.layers else None
            off = entry is not None and (entry.is_frozen() or (entry.is_off() and kind != "INSERT"))
            if off or entity.dxf.invisible:
                inside = (entity.block() or ()) if kind == "INSERT" else ()
                wanted = wanted or any(part.dxf.layer.casefold() in self.labelled for part in inside)
                self.unread[f"hidden {kind} on layer {layer}"] += int(wanted)
            elif kind == "INSERT":
                yield from self._inserted(entity, matrix, layer, depth, whole, tags)
            elif wanted:
                corners, is_open = self._corners(entity, kind, matrix)
                if len(corners):
                    yield Piece(layer, f"{kind} {entity.dxf.handle or ''}".strip(), corners, is_open, tags)
                else:
                    self.unread[f"{kind} on layer {layer}"] += 1

    def _inserted(
        self, insert: Any, matrix: Any, layer: str, depth: int, whole: bool, tags: tuple[str, ...]
    ) -> Iterator[Piece]:
        """A block as often as it is inserted: one piece where its layer has a label, and none in it is on another layer
        with one; else what is in it."""
        from ezdxf.xclip import XClip

        block = insert.block()
        if block is None or block.block.is_xref or block.block.is_xref_overlay:
            self.unread[f"block {insert.dxf.name} in another file (XREF)"] += 1
            return
        if depth >= DEEPEST_BLOCK:
            raise OutputError(f"blocks are within blocks more than {DEEPEST_BLOCK} deep")
        is_one = bool(tags) or layer.casefold() in self.labelled
        for copy in insert.multi_insert() if insert.mcount > 1 else (insert,):
            self._spend(1)
            inside = list(self._read(block, copy.matrix44() * matrix, layer, depth + 1, whole or is_one))
            others = {piece.layer.casefold() for piece in inside} - {layer.casefold()}
            if inside and is_one and others.isdisjoint(self.labelled):
                name = f"INSERT {insert.dxf.handle or ''}".strip()
                inside = [Piece(layer, name, np.concatenate([piece.corners for piece in inside]), False, tags)]
            if inside and XClip(insert).is_clipping_enabled:
                self.unread[f"clipping (XCLIP) of block {insert.dxf.name}"] += 1
            yield from inside

    def _corners(self, entity: Any, kind: str, matrix: Any) -> tuple[Floats, bool]:
        """Corners (n, 3) of an entity in the world of the drawing, none where it is not read or is damaged, and whether
        lines may go on from it. Those of a curve are its ends, and what is farthest along each axis of the world."""
        from ezdxf.disassemble import make_primitive
        from ezdxf.path import make_path

        nothing = np.zeros((0, 3))
        if kind not in READ or (kind == "MESH" and entity.dxf.subdivision_levels):
            return nothing, False
        is_line = kind == "LWPOLYLINE" or (kind == "POLYLINE" and (entity.is_2d_polyline or entity.is_3d_polyline))
        try:
            if kind == "MLINE":
                parts = [self._corners(part, part.dxftype(), matrix)[0] for part in entity.virtual_entities()]
                return np.concatenate([nothing, *parts]), False
            if kind in ("SPLINE", "HELIX") and not entity.construction_tool().is_clamped:
                return nothing, False  # ezdxf takes it from beyond its first knots
            if kind == "POLYLINE":
                drawn = [v for v in entity.vertices if not (v.is_face_record or v.dxf.flags & CONTROL_POINT)]
                entity.vertices[:] = drawn
            is_curved = kind in CURVES or (is_line and entity.has_arc)
            is_path = is_curved or is_line
            if is_path:
                given = list(make_path(entity).approximate(CHORDS))
            else:
                given = list(entity.points() if kind == "POLYLINE" else make_primitive(entity).vertices())
            is_open = kind in ("LINE", "3DFACE") or (is_path and not given[0].isclose(given[-1]))
            if is_line and entity.has_width:
                given += make_primitive(entity).vertices()
            up = entity.dxf.extrusion * entity.dxf.thickness if entity.dxf.hasattr("thickness") else None
            points = np.array([point.xyz for point in matrix.transform_vertices(given)])
        except (ArithmeticError, LookupError, TypeError, ValueError, AttributeError):  # ezdxf's, of what is damaged
            return nothing, False
        self._spend(0, len(points))
        if is_curved:
            widths = np.ptp(points, axis=0)
            wide = widths > FLAT * widths.max()
            far = [*points.argmin(axis=0)[wide], *points.argmax(axis=0)[wide]]
            points = points[[0, -1, *far] if is_open else far]
        if up is not None:
            points = np.concatenate([points, points + matrix.transform_direction(up).xyz])
        return points, is_open

    def _spend(self, entities: int, corners: int = 0) -> None:
        self.entities -= entities
        self.corners -= corners
        if self.entities < 0 or self.corners < 0:
            raise OutputError(
                f"it holds more than {MOST_ENTITIES} entities or {MOST_POINTS} corners, which is the most that is read"
            )


def _undrawn(text: str) -> str:
    """A text whose codes of drawings stand for what they mean (`exports.models.dxf.drawn_text`)."""
    return text.replace("%%%%%%", "%%").replace("^ ", "^")


def _written_by_savmap(pieces: Sequence[Piece], metres: float, options: ImportOptions) -> Iterator[SurveyElement]:
    """The structures of a drawing that savmap wrote, which stand in the world."""
    groups = dict[tuple[str, ...], list[Piece]]()
    for piece in pieces:
        groups.setdefault(piece.tags[:4], []).append(piece)
    for (row, _, name, label), group in groups.items():
        text = "".join(group[0].tags[4:])
        structure = element(name, label, _corners_of(group) * metres, attributes={"text": text} if text else {})
        yield SurveyElement(row, options.frame or "world", structure)


def _corners_of(pieces: Sequence[Piece]) -> Floats:
    """The corners of pieces, each once, in their order."""
    corners = np.concatenate([piece.corners for piece in pieces])
    _, first = np.unique(np.round(corners, SAME_DIGITS), axis=0, return_index=True)
    return corners[np.sort(first)]


def _drawn(
    pieces: Sequence[Piece], metres: float, options: ImportOptions, labels: Mapping[str, str]
) -> Iterator[SurveyElement]:
    """The elements on layers that have a label."""
    groups = [[piece] for piece in pieces if not piece.open]
    groups += _touching([piece for piece in pieces if piece.open], metres)
    for group in groups:
        name, layer = group[0].name, group[0].layer
        structure = element(f"{name} on layer {layer}", labels[layer.casefold()], _corners_of(group) * metres)
        yield SurveyElement("", options.usual_frame, structure)


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
