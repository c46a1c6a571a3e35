"""A map as Universal Scene Description (https://openusd.org): metres, z up, as text (.usda), or binary (.usdc) by the
library `usd-core`.

Below `/World`, a transform for each row stands at the row's origin, with a prim for each structure below it: a mesh
that other things collide with, curves, or points. Labels are those of UsdSemantics; what else is known of a structure
is in attributes that begin with `savmap:`.
"""

import re
import tempfile
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np

from savmap.errors import OutputError
from savmap.files.atomic import write_bytes
from savmap.files.texts import SURROGATES
from savmap.maps.exports import require_library
from savmap.maps.exports.marks import attributes, colours, linear, maker, sigmas, unique
from savmap.maps.exports.models.bodies import Part, RowParts, depth_note, parts_of
from savmap.types import Floats, SiteMap

THICKNESS_M = 1 / 128
"""Of drawn lines and points: what shows at ten metres, and has a half that is exact in single precision, as validators
compare it."""
WIDTHS = (f"float[] widths = [{THICKNESS_M}] (", '    interpolation = "constant"', ")")
LONGEST_NAME = 60
CONTROL = re.compile("[\x00-\x1f\x7f]")
ESCAPES = {"\n": "\\n", "\r": "\\r", "\t": "\\t", "\x00": "\ufffd"}
HEAD = """#usda 1.0
({doc}
    customLayerData = {{
        string creator = {maker}
    }}
    defaultPrim = "World"
    metersPerUnit = 1
    upAxis = "Z"
)
"""


def write_usda(site: SiteMap, path: Path) -> None:
    """The map as text. Raises OutputError where rows have no common frame."""
    write_bytes(path, usda_text(site).encode())


def write_usdc(site: SiteMap, path: Path) -> None:
    """The same, binary. Raises OutputError, also where `usd-core` is missing."""
    require_library("pxr.Sdf", "usd")
    from pxr import Sdf

    layer = Sdf.Layer.CreateAnonymous()
    with tempfile.TemporaryDirectory() as folder:
        binary = Path(folder) / "map.usdc"
        if not (layer.ImportFromString(usda_text(site)) and layer.Export(str(binary))):
            raise OutputError(f"{path}: usd-core cannot write this map")
        write_bytes(path, binary.read_bytes())


def usda_text(site: SiteMap) -> str:
    """The text of the stage."""
    rows = parts_of(site)
    palette = colours(part.structure.label for row in rows for part in row.parts)
    materials = dict(zip(palette, unique([prim_name(label) for label in palette]), strict=True))
    names = unique(["Looks", *(prim_name(row.name) for row in rows)])[1:]
    lines = ['def Xform "World"', "{", '    def Scope "Looks"', "    {"]
    for label, colour in palette.items():
        lines += _indented(_indented(_material(materials[label], linear(colour))))
    lines += ["    }"]
    for name, row in zip(names, rows, strict=True):
        lines += ["", *_indented(_row(site, row, name, materials))]
    note = depth_note(rows)
    doc = f"\n    doc = {quoted(note)}" if note else ""
    return "\n".join([HEAD.format(doc=doc, maker=quoted(maker())), *lines, "}", ""])


def prim_name(text: str) -> str:
    """A name that a prim or an attribute may have, of any text."""
    name = re.sub("[^A-Za-z0-9_]", "_", text[:LONGEST_NAME])
    return name if re.match("[A-Za-z_]", name) else f"_{name}"


def quoted(text: str) -> str:
    """A text as USD's text files hold it."""
    whole = SURROGATES.sub("\ufffd", text).replace("\\", "\\\\").replace('"', '\\"')
    return '"' + CONTROL.sub(lambda match: ESCAPES.get(match[0], f"\\{ord(match[0]):03o}"), whole) + '"'


def _material(name: str, colour: tuple[float, float, float]) -> Iterator[str]:
    yield from (f'def Material "{name}"', "{")
    yield f"    token outputs:surface.connect = </World/Looks/{name}/Surface.outputs:surface>"
    yield from ("", '    def Shader "Surface"', "    {")
    yield '        uniform token info:id = "UsdPreviewSurface"'
    yield f"        color3f inputs:diffuseColor = {_vector(colour)}"
    yield from ("        float inputs:roughness = 0.8", "        token outputs:surface", "    }", "}")


def _row(site: SiteMap, row: RowParts, name: str, materials: dict[str, str]) -> Iterator[str]:
    verdict = site.rows[row.name].verdict
    yield from (f'def Xform "{name}" (', f"    displayName = {quoted(row.name)}", ")", "{")
    yield f"    custom string savmap:row = {quoted(row.name)}"
    if verdict:
        yield f"    custom token savmap:grade = {quoted(verdict.grade)}"
    yield f"    double3 xformOp:translate = ({', '.join(repr(float(value)) for value in row.origin)})"
    yield '    uniform token[] xformOpOrder = ["xformOp:translate"]'
    names = unique([prim_name(part.structure.id) for part in row.parts])
    for prim, part in zip(names, row.parts, strict=True):
        yield ""
        yield from _indented(_prim(part, row.origin, prim, materials[part.structure.label]))
    yield "}"


def _prim(part: Part, origin: Floats, name: str, material: str) -> Iterator[str]:
    kind, schemas, shape = _shape(part, origin)
    applied = ", ".join(f'"{schema}"' for schema in (*schemas, "MaterialBindingAPI", "SemanticsLabelsAPI:class"))
    yield f'def {kind} "{name}" ('
    yield f"    prepend apiSchemas = [{applied}]"
    yield f"    displayName = {quoted(part.structure.id)}"
    yield from (")", "{")
    yield from _indented(shape)
    yield f"    token[] semantics:labels:class = [{quoted(part.structure.label)}]"
    yield f"    rel material:binding = </World/Looks/{material}>"
    yield from _indented(_facts(part))
    yield "}"


def _shape(part: Part, origin: Floats) -> tuple[str, tuple[str, ...], list[str]]:
    """The kind of prim, the schemas that are applied to it, and what it says of its shape."""
    structure = part.structure
    if part.body is not None:
        points, triangles = part.body.points - origin, part.body.triangles
        return (
            "Mesh",
            ("PhysicsCollisionAPI", "PhysicsMeshCollisionAPI"),
            [
                *_points(points, 0.0),
                f"int[] faceVertexCounts = [{', '.join('3' for _ in triangles)}]",
                f"int[] faceVertexIndices = [{', '.join(map(str, triangles.ravel().tolist()))}]",
                f"normal3f[] normals = [{_vectors(part.body.normals)}] (",
                '    interpolation = "uniform"',
                ")",
                'uniform token orientation = "rightHanded"',
                'uniform token subdivisionScheme = "none"',
                'uniform token physics:approximation = "none"',
            ],
        )
    if len(structure.edges):
        ends = structure.vertices[structure.edges.ravel()] - origin
        lines = [
            'uniform token type = "linear"',
            f"int[] curveVertexCounts = [{', '.join('2' for _ in structure.edges)}]",
        ]
        return "BasisCurves", (), [*_points(ends, THICKNESS_M), *lines, *WIDTHS]
    if len(structure.vertices):
        return "Points", (), [*_points(structure.vertices - origin, THICKNESS_M), *WIDTHS]
    return "Scope", (), []


def _points(points: Floats, thickness: float) -> list[str]:
    single = np.round(points, 6).astype(np.float32)
    half = np.float32(thickness / 2)
    low, high = (
        f"({', '.join(f'{value:.9g}' for value in end)})" for end in (single.min(0) - half, single.max(0) + half)
    )
    return [f"float3[] extent = [{low}, {high}]", f"point3f[] points = [{_vectors(points)}]"]


def _facts(part: Part) -> Iterator[str]:
    """What is known of a structure beside its shape. Its vertices are those of the world's frame."""
    structure = part.structure
    for name, text in (("row", part.row), ("plugin", part.plugin), ("id", structure.id), ("label", structure.label)):
        yield f"custom string savmap:{name} = {quoted(text)}"
    if part.ifc_class:
        yield f"custom token savmap:ifcClass = {quoted(part.ifc_class)}"
    if part.body is not None:
        yield f"custom bool savmap:depthAssumed = {'true' if part.assumed else 'false'}"
    if part.warnings:
        yield f"custom string[] savmap:warnings = [{', '.join(map(quoted, part.warnings))}]"
    yield f"custom string[] savmap:vertexLabels = [{', '.join(map(quoted, structure.vertex_labels))}]"
    yield f"custom double3[] savmap:vertices = [{_vectors(structure.vertices)}]"
    yield f"custom double3[] savmap:sigmas = [{_vectors(sigmas(structure))}]"
    values = attributes(structure)
    for name, value in zip(unique([prim_name(name) for name in values]), values.values(), strict=True):
        kind, text = "double", repr(float(value)) if not isinstance(value, str) else quoted(value)
        if isinstance(value, str):
            kind = "string"
        elif not isinstance(value, float) and abs(value) < 2**63:
            kind, text = "int64", str(int(value))
        yield f"custom {kind} savmap:attributes:{name} = {text}"


def _vectors(points: Floats) -> str:
    return ", ".join(map(_vector, points.tolist()))


def _vector(values: Iterable[float]) -> str:
    """To a thousandth of a millimetre."""
    return f"({', '.join(f'{round(float(value), 6) + 0.0!r}' for value in values)})"


def _indented(lines: Iterable[str]) -> list[str]:
    return [f"    {line}" if line else line for line in lines]
