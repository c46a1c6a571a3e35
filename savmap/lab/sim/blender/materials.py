"""Procedural materials of the path-traced pictures: painted steel, concrete, wood, cartons, film, wire decks, lamps.

All read the vertices' attributes (mesh.Mesh), so that one material serves every box of its kind. Lengths are metres.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import bpy

from savmap.lab.sim.blender.mesh import ATTRIBUTES, Shader
from savmap.lab.sim.blender.nodes import Graph, Socket
from savmap.lab.sim.blender.style import RenderStyle


@dataclass(frozen=True)
class Surface:
    """What a material's pattern gives: sockets or numbers; `height` (0..1) is a bump `depth_m` deep."""

    color: Any
    roughness: Any
    metallic: Any = 0.0
    height: Any = None
    depth_m: float = 0.002
    coat: float = 0.0


class Inputs:
    """The attributes of the mesh as sockets."""

    def __init__(self, g: Graph) -> None:
        self.local, self.flat, self.extent, self.color, self.second, params, traits, tag = map(g.attribute, ATTRIBUTES)
        self.u, self.v, _ = g.parts(self.flat)
        self.width, self.height, _ = g.parts(self.extent)
        self.scale, self.contrast, self.roughness = g.parts(params)
        self.metallic, self.emission, self.random = g.parts(traits)
        self.tagged, self.perforated, _ = g.parts(tag)


def _all(g: Graph, *shares: Socket) -> Socket:
    product = shares[0]
    for share in shares[1:]:
        product = g.math("MULTIPLY", product, share)
    return product


def _print(g: Graph, i: Inputs, style: RenderStyle, period: Any, half: tuple[float, float], color: Any) -> Any:
    """`color` with printed stickers on tagged boxes: one at most every `period` (m) along u, `half` (m) their half
    sides."""
    cell = g.math("FLOOR", g.math("DIVIDE", i.u, period))
    seat = g.vector(cell, i.random, i.width)
    u = g.math("SUBTRACT", g.saw(i.u, period), g.math("MULTIPLY", g.math("SUBTRACT", g.dice(seat), 0.5), 0.2))
    lift = g.math("MULTIPLY", g.math("SUBTRACT", i.random, 0.5), g.math("MULTIPLY", i.height, 0.3))
    v = g.math("SUBTRACT", i.v, lift)
    shown = g.math("LESS_THAN", g.dice(g.scaled(seat, 1.7)), style.wear.labels)
    fits = g.math("GREATER_THAN", i.height, 2.2 * half[1])
    sticker = _all(g, g.inside(u, half[0]), g.inside(v, half[1]), shown, fits, i.tagged)
    bars = g.math("GREATER_THAN", g.dice(g.vector(g.math("FLOOR", g.math("MULTIPLY", i.u, 250.0)), 0.0, 0.0)), 0.5)
    bars = _all(g, bars, g.inside(u, half[0] * 0.8), g.inside(g.math("ADD", v, half[1] * 0.3), half[1] * 0.5))
    ink = g.mix(bars, style.wear.print_color, (0.02, 0.02, 0.02))
    return g.mix(sticker, color, ink)


def _worn(g: Graph, i: Inputs, style: RenderStyle, color: Any) -> Any:
    """Dirt in clouds, rust in spots, scratches along the box."""
    wear = style.wear
    clouds = g.ramp(g.noise(i.local, 2.5, 3.0), 0.45, 0.75)
    color = g.mix(g.math("MULTIPLY", clouds, wear.dirt * 0.6), color, (0.09, 0.075, 0.06))
    if wear.rust:
        spots = g.ramp(g.noise(i.local, 9.0, 3.0), 0.72 - 0.25 * wear.rust, 0.8 - 0.2 * wear.rust)
        color = g.mix(spots, color, (0.16, 0.05, 0.02))
    if wear.scratches:
        x, y, z = g.parts(i.local)
        lines = g.noise(g.vector(x, g.math("MULTIPLY", y, 22.0), g.math("MULTIPLY", z, 22.0)), 4.0)
        color = g.mix(g.math("MULTIPLY", g.ramp(lines, 0.68, 0.72), wear.scratches), color, (0.45, 0.45, 0.45))
    return color


def _holes(g: Graph, i: Inputs, style: RenderStyle) -> Socket:
    """Perforations: columns of slots along v of faces that are tall and narrow."""
    columns = style.wear.hole_columns
    pitch = g.math("DIVIDE", i.width, columns)
    aside = g.saw(g.math("ADD", i.u, g.math("MULTIPLY", i.width, 0.5)), pitch)
    period = g.math("MAXIMUM", i.scale, 0.03)
    along = g.saw(g.math("ADD", i.v, i.random), period)
    slot = g.math("LESS_THAN", g.math("ABSOLUTE", aside), g.math("MULTIPLY", pitch, 0.16))
    length = g.inside(along, g.math("MULTIPLY", period, 0.5 * style.wear.hole_size))
    tall = g.math("GREATER_THAN", i.height, g.math("MULTIPLY", i.width, 8.0))
    wide = g.math("LESS_THAN", i.width, 0.3)
    return _all(g, slot, length, tall, wide, i.perforated)


def _paint(g: Graph, i: Inputs, style: RenderStyle) -> Surface:
    tint = g.blend(g.noise(i.local, 6.0, 1.0), 0.9, 1.1)
    color = _print(g, i, style, 0.9, (0.075, 0.03), _worn(g, i, style, g.tinted(i.color, tint)))
    color = g.mix(_holes(g, i, style), color, (0.008, 0.008, 0.009))
    return Surface(color, i.roughness, i.metallic)


def _stripes(g: Graph, i: Inputs, style: RenderStyle) -> Surface:
    along = g.blend(g.math("GREATER_THAN", i.width, i.height), i.v, i.u)
    wave = g.saw(g.math("ADD", i.u, i.v) if style.number == 2 else along, i.scale)
    color = g.mix(g.math("GREATER_THAN", wave, 0.0), i.color, i.second)
    return Surface(_worn(g, i, style, color), i.roughness, 0.0)


def _concrete(g: Graph, i: Inputs, style: RenderStyle) -> Surface:
    fine, coarse = g.noise(i.local, 14.0, 4.0), g.noise(i.local, 0.5, 3.0)
    color = g.tinted(i.color, g.blend(coarse, 0.55, 1.4))
    color = g.tinted(color, g.blend(fine, 0.8, 1.2))
    if style.wear.marble:
        vein = g.ramp(g.math("ABSOLUTE", g.math("SUBTRACT", g.noise(i.local, 1.3, 6.0), 0.5)), 0.0, 0.05)
        color = g.mix(vein, g.tinted(i.color, 0.3), color)
    seams = g.math("MAXIMUM", *(g.inside(g.saw(s, style.wear.slab_m), 0.008) for s in (i.u, i.v)))
    color = g.mix(g.math("MULTIPLY", seams, 0.7), color, (0.03, 0.03, 0.03))
    rough = g.blend(coarse, 0.95 - 0.6 * style.wear.floor_gloss, 1.0 - 0.8 * style.wear.floor_gloss)
    return Surface(color, rough, 0.0, fine, 0.002)


def _wood(g: Graph, i: Inputs, style: RenderStyle) -> Surface:
    grain = g.noise(i.local, 60.0, 4.0)
    base = g.mix(i.random, (0.42, 0.26, 0.12), (0.25, 0.2, 0.15))
    color = g.mix(g.ramp(grain, 0.3, 0.7), g.tinted(base, 0.55), base)
    return Surface(_worn(g, i, style, color), 0.8, 0.0, grain, 0.002)


def _carton(g: Graph, i: Inputs, style: RenderStyle) -> Surface:
    flutes = g.ramp(g.math("ABSOLUTE", g.saw(i.u, 0.007)), 0.0, 0.0035)
    color = g.tinted(i.color, g.blend(g.noise(i.local, 5.0, 3.0), 0.75, 1.25))
    color = g.tinted(color, g.blend(flutes, 0.93, 1.07))
    tape = _all(g, g.inside(i.u, 0.03), g.math("GREATER_THAN", i.random, 0.4))
    color = g.mix(g.math("MULTIPLY", tape, 0.6), color, g.tinted(i.color, 0.55))
    band = g.inside(g.math("SUBTRACT", i.v, g.math("MULTIPLY", i.height, 0.22)), g.math("MULTIPLY", i.height, 0.09))
    color = g.mix(_all(g, band, g.math("LESS_THAN", i.random, 0.3)), color, i.second)
    color = _print(g, i, style, g.math("MAXIMUM", i.width, 0.1), (0.08, 0.06), color)
    return Surface(color, g.blend(tape, 0.85, 0.3))


def _film(g: Graph, i: Inputs, style: RenderStyle) -> Surface:
    """Goods under shrink wrap: wrinkles, a whitish veil, sharp glints."""
    wrinkles = g.noise(i.local, 11.0, 2.0)
    veil = g.math("MULTIPLY", g.ramp(wrinkles, 0.45, 0.75), 0.55)
    color = g.mix(veil, g.tinted(i.color, g.blend(g.noise(i.local, 4.0), 0.6, 1.3)), (0.75, 0.78, 0.8))
    color = _print(g, i, style, g.math("MAXIMUM", i.width, 0.1), (0.1, 0.07), color)
    return Surface(color, 0.22, 0.0, wrinkles, 0.02, coat=0.6)


def _checker(g: Graph, i: Inputs, style: RenderStyle) -> Surface:
    """Goods of style 3: patchwork and rings, printed in two colours."""
    cells = g.made("ShaderNodeTexVoronoi", {"Vector": i.local, "Scale": 9.0}).outputs["Distance"]
    rings = g.math("GREATER_THAN", g.saw(cells, 0.22), 0.0)
    share = g.math("MULTIPLY", rings, g.ramp(i.random, 0.3, 0.9))
    color = g.tinted(g.mix(share, i.color, i.second), g.blend(g.noise(i.local, 3.0, 4.0), 0.6, 1.3))
    color = _print(g, i, style, g.math("MAXIMUM", i.width, 0.1), (0.12, 0.05), color)
    return Surface(color, g.blend(i.random, 0.15, 0.8), 0.0, cells, 0.01)


def _paper(g: Graph, i: Inputs, style: RenderStyle) -> Surface:
    """Signs and stickers: lines of print and a bar code."""
    rows, columns = g.math("DIVIDE", i.v, i.height), g.math("MULTIPLY", i.u, 180.0)
    cell = g.vector(g.math("FLOOR", columns), g.math("FLOOR", g.math("MULTIPLY", rows, 7.0)), i.random)
    bars = g.dice(g.vector(g.math("FLOOR", g.math("MULTIPLY", columns, 2.0)), i.random, 0.0))
    upper = g.math("GREATER_THAN", rows, 0.0)
    ink = g.math("GREATER_THAN", g.blend(upper, bars, g.dice(cell)), 0.55)
    margin = _all(g, g.inside(rows, 0.36), g.inside(g.math("DIVIDE", i.u, i.width), 0.42))
    return Surface(g.mix(_all(g, ink, margin), i.color, (0.02, 0.02, 0.03)), 0.6)


def _wire(g: Graph, i: Inputs, style: RenderStyle) -> Surface:
    return Surface(i.color, 0.4, 0.8)


_SURFACES: dict[Shader, Callable[[Graph, Inputs, RenderStyle], Surface]] = {
    "paint": _paint,
    "stripes": _stripes,
    "concrete": _concrete,
    "wood": _wood,
    "carton": _carton,
    "film": _film,
    "checker": _checker,
    "wire": _wire,
    "paper": _paper,
}


def _bsdf(g: Graph, surface: Surface, bump: float) -> Socket:
    inputs: dict[str, Any] = {
        "Base Color": surface.color,
        "Roughness": surface.roughness,
        "Metallic": surface.metallic,
        "Coat Weight": surface.coat,
    }
    if surface.height is not None:
        dent = {"Height": surface.height, "Distance": surface.depth_m, "Strength": bump}
        inputs["Normal"] = g.made("ShaderNodeBump", dent).outputs[0]
    return g.made("ShaderNodeBsdfPrincipled", inputs).outputs[0]


def _see_through(g: Graph, share: Any, shader: Socket) -> Socket:
    """`shader` where `share` is 0, nothing at all where it is 1."""
    node = g.node("ShaderNodeMixShader")
    clear = g.node("ShaderNodeBsdfTransparent").outputs[0]
    for socket, value in zip(node.inputs, (share, shader, clear), strict=True):
        g.feed(socket, value)
    return node.outputs[0]


def _gaps_between_wires(g: Graph, i: Inputs) -> Socket:
    mesh = g.math("MAXIMUM", i.scale, 0.04)
    wires = g.math("MAXIMUM", *(g.inside(g.saw(s, mesh), 0.0025) for s in (i.u, i.v)))
    return g.math("SUBTRACT", 1.0, wires)


def _roof_lights(g: Graph, pitch_m: float) -> Socket:
    """1 where sunlight gets through the roof: strips across the aisle, for shadow rays only."""
    x, y, _ = g.parts(g.node("ShaderNodeNewGeometry").outputs["Position"])
    strip = g.inside(g.saw(x, pitch_m), 0.22 * pitch_m)
    shadow = g.node("ShaderNodeLightPath").outputs["Is Shadow Ray"]
    return _all(g, strip, g.math("GREATER_THAN", y, 3.0), shadow)


def _lamp(g: Graph, i: Inputs, style: RenderStyle) -> Socket:
    """Seen, but not what lights the scene: `style.area_lamps` do that with fewer, larger sources, which render in less
    time."""
    light = style.light
    color = g.mix(0.7, i.color, light.lamp_color)
    strength = g.math("MULTIPLY", i.emission, light.lamp_gain)
    path = g.node("ShaderNodeLightPath")
    seen = g.math("MAXIMUM", path.outputs["Is Camera Ray"], path.outputs["Is Glossy Ray"])
    return g.made("ShaderNodeEmission", {"Color": color, "Strength": g.math("MULTIPLY", strength, seen)}).outputs[0]


def _shader(g: Graph, name: Shader, style: RenderStyle) -> Socket:
    i = Inputs(g)
    if name == "lamp":
        return _lamp(g, i, style)
    shader = _bsdf(g, _SURFACES[name](g, i, style), style.wear.bump)
    if name == "wire":
        return _see_through(g, _gaps_between_wires(g, i), shader)
    if name == "concrete" and style.light.sun:
        return _see_through(g, _roof_lights(g, style.light.pitch_m), shader)
    return shader


def material(name: Shader, style: RenderStyle) -> Any:
    """A new Blender material."""
    made = bpy.data.materials.new(name)
    made.cycles.emission_sampling = "NONE"
    g = Graph(made.node_tree)
    g.made("ShaderNodeOutputMaterial", {"Surface": _shader(g, name, style)})
    return made
