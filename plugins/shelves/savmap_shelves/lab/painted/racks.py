"""Rows of racks as boxes: posts, beams, frames, decks. Row frame: x along the row, y up, z = 0 the face, z > 0 the
aisle."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from savmap.lab.sim.paint.noise import Random
from savmap.lab.sim.paint.stage import IGNORED, Stage, Surface, Tag
from savmap.lab.sim.paint.wardrobe import Wardrobe
from savmap_shelves.lab.painted.wardrobe import Paint, paint, paints, zinc

UPRIGHT, BEAM = 1, 2
SIDES = 2
"""What is added to a member's class on its flanks, top and underside."""


@dataclass(frozen=True)
class Style:
    """How the racks of one row are made. Metres."""

    post: Surface
    flank: Surface
    post_width: float
    post_depth: float
    stepped_post: bool
    beam: Surface
    lip: Surface
    spare: Surface  # some levels' beams are of another make
    beam_height: float
    beam_thickness: float
    profile: str  # box, step, open
    setback: float
    connector: float  # height of the plate at a beam's end, 0 for none
    frame: Surface
    brace: float
    depth: float
    deck: str
    decking: Surface
    gloom: float
    under: float
    base: Surface | None  # a coat of another colour on the posts' lower metre
    backing: tuple[float, float, float]  # a mesh over the rear: pitch across and up, metres, and its wires' share
    gloss: float  # how strongly lamps shine in the beams
    guards: Surface | None
    foot: float


@dataclass(frozen=True)
class Bay:
    """One bay: between its posts' middles, with its beams' bottom edges from low to high."""

    left: float
    width: float
    levels: tuple[float, ...]


@dataclass(frozen=True)
class Row:
    """A row's geometry."""

    style: Style
    bays: tuple[Bay, ...]
    height: float

    @property
    def length(self) -> float:
        """From the first post's middle to the last one's."""
        return self.bays[-1].left + self.bays[-1].width


def random_style(rng: Random, wardrobe: Wardrobe, small: bool) -> Style:
    """A rack maker's product: `small` is hand-picked shelving, otherwise pallet racking."""
    for_posts, for_beams = paints(rng)
    size = rng.uniform(0.55, 1.0) if small else 1.0
    width = float(rng.uniform(0.045, 0.075) if small else rng.uniform(0.07, 0.14))
    height = float((rng.uniform(0.05, 0.11) if small else rng.uniform(0.08, 0.17)) * (0.9 + 0.1 * size))
    bracing = for_posts if rng.random() < 0.5 else zinc(rng) if rng.random() < 0.7 else paint(rng)
    decks = ["none", "wire", "chipboard", "steel", "bars", "grating"]
    shares = [0.06, 0.2, 0.3, 0.3, 0.08, 0.06] if small else [0.35, 0.22, 0.16, 0.1, 0.12, 0.05]
    deck = str(rng.choice(decks, p=shares))
    sheet = small and rng.random() < 0.35
    if sheet:  # folded shelves: their front edge is the beam
        height, deck = float(rng.uniform(0.025, 0.05)), "sheet"
    return Style(
        post=_surface(rng, wardrobe, for_posts, "post", (0.0, float(rng.uniform(0.35, 0.7)))),
        flank=_surface(rng, wardrobe, for_posts, "flank", (0.0, float(rng.uniform(0.35, 0.7)))),
        post_width=width,
        post_depth=float(width * rng.uniform(0.7, 1.3)),
        stepped_post=bool(rng.random() < 0.4),
        beam=_surface(rng, wardrobe, for_beams, "beam", (float(rng.uniform(1.2, 3.0)), 0.0)),
        lip=_surface(rng, wardrobe, for_beams, "", (1.0, 1.0)),
        spare=_surface(rng, wardrobe, paint(rng), "beam", (float(rng.uniform(1.2, 3.0)), 0.0)),
        beam_height=height,
        beam_thickness=float(rng.uniform(0.03, 0.06)),
        profile=str(rng.choice(["box", "box", "step", "open"])),
        setback=float(rng.choice([0.0, rng.uniform(-0.008, 0.012), rng.uniform(0, 0.035)])),
        connector=float(not sheet) * float(rng.choice([0.0, 1.0, 1.0]) * max(height + rng.uniform(0.02, 0.12), 0.12)),
        frame=_surface(rng, wardrobe, bracing, "", (0.8, 0.8)),
        brace=float(rng.uniform(0.02, 0.05)),
        depth=float(rng.uniform(0.4, 0.8) if small else rng.uniform(0.75, 1.25)),
        deck=deck,
        decking=_decking(rng, wardrobe, deck, for_beams),
        gloom=float(rng.uniform(0.1, 1.8)),
        under=float(rng.uniform(0.1, 0.85)),
        base=_surface(rng, wardrobe, paint(rng), "post", (0.0, 0.5)) if rng.random() < 0.06 else None,
        backing=_backing(rng),
        gloss=float(rng.uniform(0.1, 0.8)) if rng.random() < 0.35 else 0.0,
        guards=wardrobe.surface(rng, "hazard") if rng.random() < 0.3 else None,
        foot=float(rng.uniform(0.02, 0.06) * (rng.random() < 0.7)),
    )


def _backing(rng: Random) -> tuple[float, float, float]:
    if rng.random() < 0.88:
        return 0.0, 0.0, 0.0
    return float(rng.uniform(0.04, 0.15)), float(rng.uniform(0.04, 0.15)), float(rng.uniform(0.06, 0.2))


def _surface(rng: Random, wardrobe: Wardrobe, finish: Paint, part: str, span: tuple[float, float]) -> Surface:
    kind = "zinc" if finish.zinc else "paint"
    return Surface(wardrobe.any(rng, f"{kind}_{part}" if part else kind), finish.tint, span)


def _decking(rng: Random, wardrobe: Wardrobe, deck: str, beams: Paint) -> Surface:
    if deck == "sheet":
        return _surface(rng, wardrobe, beams, "", (1.0, 1.0))
    tone = float(rng.uniform(0.2, 1.0))
    if deck == "chipboard":
        kind = str(rng.choice(["chipboard", "wood", "plain"]))
        return wardrobe.surface(rng, kind, (tone, tone * 0.95, tone * 0.85), float(rng.uniform(0.8, 2)))
    if rng.random() < 0.3:
        return wardrobe.surface(rng, str(rng.choice(["paint", "zinc"])), paint(rng).tint, 1.0)
    return wardrobe.surface(rng, "zinc", (tone, tone, tone), 1.0)


def random_row(rng: Random, style: Style, small: bool, bays: int) -> Row:
    """Bays side by side: mostly alike, their levels mostly shared."""
    width = float(rng.uniform(0.9, 2.4) if small else rng.choice([rng.uniform(1.2, 2.0), rng.uniform(2.2, 3.7)]))
    gap = float(rng.uniform(0.32, 0.9) if small else rng.uniform(0.8, 2.1))
    top = float(rng.uniform(1.6, 3.2) if small else rng.uniform(2.5, 9.5))
    first = float(rng.choice([rng.uniform(0.06, 0.25), gap * rng.uniform(0.7, 1.3)]))
    levels = _levels(rng, first, gap, top)
    left, made = 0.0, []
    for _ in range(bays):
        wide = width if rng.random() < 0.85 else float(width * rng.uniform(0.6, 1.3))
        heights = levels if rng.random() < 0.75 else _levels(rng, first, gap * float(rng.uniform(0.7, 1.4)), top)
        made.append(Bay(left, wide, heights))
        left += wide
    return Row(style, tuple(made), top + float(rng.uniform(0.05, 1.0)))


def _levels(rng: Random, first: float, gap: float, top: float) -> tuple[float, ...]:
    levels: list[float] = []
    height = first
    regular = rng.random() < 0.6
    while height < top and len(levels) < 9:
        levels.append(float(height))
        height += gap * (1 if regular else rng.uniform(0.6, 1.4))
    return tuple(levels)


def build_row(
    stage: Stage,
    row: Row,
    wardrobe: Wardrobe,
    fill: Callable[[Bay, float, float, float], None],
    labelled: bool = True,
    detailed: Callable[[Bay], bool] = lambda bay: True,
) -> None:
    """Adds a row in the stage's frame. `fill(bay, bottom, top, depth)` adds goods to an opening; a row that is not
    `labelled` is seen from behind, its members are 255."""
    style, rng = row.style, stage.rng
    places = [bay.left for bay in row.bays] + [row.length]
    for index, x in enumerate(places):
        near = detailed(row.bays[min(index, len(row.bays) - 1)])
        _post(stage, style, x, row.height, labelled, wardrobe if near else None)
        with stage.gloom(style.gloom * 0.6):
            _frame(stage, style, x, row.height, near)
    for bay in row.bays:
        near = detailed(bay)
        floor = 0.0
        if near:
            dark = wardrobe.surface(rng, "shadow")
            low, reach = (bay.left - 0.2, 0.006, 0.3), (bay.width + 0.4, 0, 0)
            stage.quad(low, reach, (0, 0, -style.depth - 0.5), dark, veil=float(rng.uniform(0.2, 0.8)))
        if near and style.backing[2]:
            across, up, share = style.backing
            mesh = (bay.width / across, row.height / up, share)
            with stage.gloom(style.gloom):
                stage.quad((bay.left, 0, -style.depth), (bay.width, 0, 0), (0, row.height, 0), style.frame, mesh=mesh)
        for level, top in zip((-1.0, *bay.levels), (*bay.levels, row.height + 1.0), strict=True):
            if level >= 0:
                floor = level + style.beam_height
                _level(stage, row, bay, level, labelled, wardrobe, near)
            if top - floor > 0.15:
                with stage.gloom(style.gloom, floor, top, style.under if top < row.height else 0.1):
                    fill(bay, floor + 0.005, min(top, row.height + 0.8), style.depth)


def _tag(label: int, thickness: float, labelled: bool) -> Tag:
    return Tag(label if labelled else IGNORED, thickness)


def _post(stage: Stage, style: Style, x: float, height: float, labelled: bool, wardrobe: Wardrobe | None) -> None:
    """A front post, with foot, guard, splice and stickers where it is seen well."""
    half, depth = style.post_width / 2, style.post_depth
    tag = _tag(UPRIGHT, style.post_width, labelled)
    if style.stepped_post:
        stage.box((x - half, 0, -0.35 * depth), (x + half, height, 0), style.post, style.flank, tag=tag)
        inner = 0.72 * half
        stage.box((x - inner, 0, -depth), (x + inner, height, -0.3 * depth), style.flank, tag=tag, shade=0.8)
        stage.box((x - half, 0, -1.05 * depth), (x + half, height, -0.85 * depth), style.flank, tag=tag, shade=0.9)
    else:
        stage.box((x - half, 0, -depth), (x + half, height, 0), style.post, style.flank, tag=tag)
    if wardrobe is None:
        return
    rng = stage.rng
    if style.base is not None:
        tall = float(rng.uniform(0.6, 1.2))
        low, high = (x - half - 0.002, 0, -depth - 0.002), (x + half + 0.002, tall, 0.002)
        stage.box(low, high, style.base, style.base, tag=tag)
    if style.foot:
        wide = half + style.foot
        stage.box((x - wide, 0, -depth - style.foot), (x + wide, 0.012, style.foot), style.frame)
    if style.guards is not None and rng.random() < 0.7:
        tall = float(rng.uniform(0.25, 0.7))
        reach = float(rng.uniform(0.03, 0.12))
        stage.box((x - half - 0.03, 0, -depth), (x + half + 0.03, tall, reach), style.guards)
    if rng.random() < 0.08:
        at = float(rng.uniform(1.0, 4.0))
        stage.box(
            (x - half - 0.006, at, -0.8 * depth), (x + half + 0.006, at + 0.3, 0.006), style.post, style.flank, tag=tag
        )
    if rng.random() < 0.05:  # a notice that stands out into the aisle
        at, wide = float(rng.uniform(1.6, 3.5)), float(rng.uniform(0.15, 0.5))
        stage.box((x - 0.01, at, 0.01), (x + 0.01, at + 0.7 * wide, wide), wardrobe.surface(rng, "poster"))
    if rng.random() < 0.25:
        at, size = float(rng.uniform(0.5, 2.5)), style.post_width * float(rng.uniform(0.5, 0.95))
        sticker = wardrobe.surface(rng, str(rng.choice(["label", "poster", "hazard"])))
        stage.quad(
            (x - size / 2, at, 0.004), (size, 0, 0), (0, size * float(rng.uniform(0.6, 2.0)), 0), sticker, tag=tag
        )


def _frame(stage: Stage, style: Style, x: float, height: float, near: bool) -> None:
    """The rear post and the bracing between the two."""
    half, back, inner = style.post_width / 2, -style.depth, -style.post_depth
    rear = Tag(0, style.post_width)
    stage.box((x - half, 0, back), (x + half, height, back + style.post_depth), style.flank, tag=rear, shade=0.8)
    if not near:
        return
    thin, pitch = style.brace / 2, max(0.5, style.depth)
    reach = -inner - back - 2 * style.post_depth
    levels = np.arange(0.15, height - 0.1, pitch)
    for index, y in enumerate(levels):
        if index % 2 == 0:
            stage.box((x - thin, y, back + 0.02), (x + thin, y + style.brace, inner), style.frame, shade=0.8)
        run = abs(reach) if reach else style.depth
        rise = pitch * (1 if index % 2 else -1)
        tilt = math.degrees(math.atan2(rise, run))
        start = y if index % 2 else y + pitch
        if start + max(rise, 0) < height and start + min(rise, 0) > 0:
            with stage.frame((x, start, inner), 0.0, tilt):
                stage.box((-thin, 0, -math.hypot(run, rise)), (thin, style.brace, 0), style.frame, shade=0.8)


def _level(stage: Stage, row: Row, bay: Bay, y: float, labelled: bool, wardrobe: Wardrobe, near: bool) -> None:
    """The front and rear beams of a level, what lies on them, and what sticks to them."""
    style = row.style
    left, right = bay.left + style.post_width / 2, bay.left + bay.width - style.post_width / 2
    front, top = -style.setback, y + style.beam_height
    tag = _tag(BEAM, style.beam_height, labelled)
    if stage.rng.random() < 0.05:
        style = replace(style, beam=style.spare, lip=replace(style.spare, span=(1.0, 1.0)))
    _beam(stage, style, (left, right), y, front, tag)
    if style.connector and near:
        plate = 0.5 * (style.beam_height - style.connector)
        for x in (left - 0.008, right - 0.035):
            low, high = (x, y + plate, front - 0.05), (x + 0.043, y + plate + style.connector, front + 0.004)
            stage.box(low, high, style.lip, tag=tag)
    with stage.gloom(style.gloom, y - 0.5, y + 1.0, 0.0):
        back = -style.depth
        rear = Tag(0, style.beam_height)
        stage.box(
            (left, y, back), (right, top, back + style.beam_thickness), style.beam, style.lip, tag=rear, shade=0.7
        )
        _deck(stage, style, left, right, top, near)
    if near:
        _stuck(stage, style, (left, right), y, front, tag, wardrobe)


def _beam(stage: Stage, style: Style, ends: tuple[float, float], y: float, front: float, tag: Tag) -> None:
    (left, right), thick, tall = ends, style.beam_thickness, style.beam_height
    if style.profile == "step":
        ledge = y + tall * 0.7
        stage.box((left, y, front - thick), (right, ledge, front), style.beam, style.lip, tag=tag)
        stage.box((left, ledge, front - thick), (right, y + tall, front - 0.35 * thick), style.lip, tag=tag, shade=0.85)
    elif style.profile == "open":
        lip = 0.18 * tall
        stage.box((left, y, front - thick), (right, y + lip, front), style.lip, tag=tag)
        stage.box((left, y + tall - lip, front - thick), (right, y + tall, front), style.lip, tag=tag)
        stage.box(
            (left, y, front - thick), (right, y + tall, front - 0.6 * thick), style.beam, style.lip, tag=tag, shade=0.75
        )
    else:
        stage.box((left, y, front - thick), (right, y + tall, front), style.beam, style.lip, tag=tag)


def _deck(stage: Stage, style: Style, left: float, right: float, top: float, near: bool) -> None:
    back, front = -style.depth, -style.setback - 0.01
    if style.deck in ("chipboard", "steel", "sheet"):
        thick = {"chipboard": 0.022, "steel": 0.03, "sheet": 0.003}[style.deck]
        drop = 0.004 if style.profile != "step" else thick
        stage.box((left, top + 0.004 - drop, back), (right, top + 0.004 - drop + thick, front), style.decking)
    elif style.deck in ("wire", "grating") and near:
        pitch = 0.05 if style.deck == "wire" else 0.03
        mesh = ((right - left) / pitch, style.depth / (2 * pitch), 0.16)
        stage.quad((left, top + 0.003, front), (right - left, 0, 0), (0, 0, back - front), style.decking, mesh=mesh)
    if style.deck in ("bars", "wire", "none") and near:
        for x in np.linspace(left, right, int(stage.rng.integers(2, 6)) + 2)[1:-1] if style.deck != "none" else ():
            stage.box((x - 0.02, top - 0.04, back), (x + 0.02, top, front), style.decking, shade=0.8)


def _stuck(
    stage: Stage, style: Style, ends: tuple[float, float], y: float, front: float, tag: Tag, wardrobe: Wardrobe
) -> None:
    """Labels, price strips, placards and straps on a beam: they stay beam."""
    rng, (left, right), tall = stage.rng, ends, style.beam_height
    z = front + 0.004

    def stick(kind: str, x: float, width: float, low: float, height: float) -> None:
        stage.quad(
            (x, y + low, z), (width, 0, 0), (0, height, 0), wardrobe.surface(rng, kind), tag=tag, two_sided=False
        )

    if rng.random() < 0.45:
        for x in rng.uniform(left, right - 0.15, int(rng.integers(1, 5))):
            high = tall * float(rng.uniform(0.4, 0.85))
            stick("label", float(x), high * float(rng.uniform(1.0, 2.5)), (tall - high) / 2, high)
    if rng.random() < 0.1:
        stick("strip", left, right - left, tall * 0.25, tall * float(rng.uniform(0.3, 0.6)))
    if rng.random() < 0.08:
        wide = float(rng.uniform(0.2, 0.5))
        stick("poster", float(rng.uniform(left, right - wide)), wide, tall * 0.08, tall * 0.84)
    if style.gloss and rng.random() < 0.7:
        x, wide = float(rng.uniform(left, right)), float(rng.uniform(0.2, 0.9))
        shine = wardrobe.surface(rng, "shine", (2.0, 2.0, 1.9))
        stage.quad((x - wide / 2, y, z + 0.003), (wide, 0, 0), (0, tall, 0), shine, veil=style.gloss, tag=tag)
    if rng.random() < 0.05:
        stick("plain", float(rng.uniform(left, right)), 0.04, 0.0, tall)
