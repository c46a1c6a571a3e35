"""Lamps of many kinds, in lines: strips along and across, lines of light with narrow joints, squares, discs; their
luminous bodies are labelled."""

import math
from dataclasses import dataclass, replace

import numpy as np

from savmap.lab.sim.paint.noise import Random
from savmap.lab.sim.paint.stage import Stage, Surface, Tag
from savmap.lab.sim.paint.wardrobe import Wardrobe, grey
from savmap.types import Floats
from savmap_lights.lab.painted.hall import Hall, tinted

LIGHT = 1
_JUDGED = 2.5
"""Lamps are judged down to 1.2 px, thinner than other members are."""


@dataclass(frozen=True)
class Style:
    """Lamps of one kind: metres; `across` the aisle; a `case` above, wider than the lamp by its share; two `tubes`;
    rods they hang from."""

    kind: str
    long: float
    wide: float
    thick: float
    gap: float
    across: bool
    case: float
    tubes: bool
    rods: bool
    body: Surface
    shell: Surface


def random_style(rng: Random, wardrobe: Wardrobe) -> Style:
    """Four in ten are strips with gaps between them, as many lines of light, the rest compact."""
    kind = str(rng.choice(["strip", "line", "square", "disc"], p=[0.4, 0.38, 0.12, 0.1]))
    strength = float(np.exp(rng.uniform(math.log(5), math.log(60))))
    warm = float(rng.uniform(-0.08, 0.15))
    body = wardrobe.surface(rng, "plain", (strength, strength * (1 - warm / 2), strength * (1 - warm)))
    shell = wardrobe.surface(rng, str(rng.choice(["plain", "zinc", "paint"])), tinted(rng, 0.1, 0.9))
    compact = kind in ("square", "disc")
    long = float(rng.uniform(0.2, 0.8)) if compact else float(rng.uniform(0.55, 3.0))
    return Style(
        kind=kind,
        long=long,
        wide=long if compact else float(np.exp(rng.uniform(math.log(0.03), math.log(0.4)))),
        thick=float(rng.uniform(0.005, 0.12)),
        gap=float(rng.choice([0.0, 0.005, 0.02, 0.04, 0.06, 0.1])) if kind == "line" else float(rng.uniform(0.2, 5.0)),
        across=kind == "strip" and rng.random() < 0.25,
        case=float(rng.choice([0.0, 0.0, 1.05, 1.4, 2.5])),
        tubes=kind in ("strip", "line") and rng.random() < 0.15,
        rods=rng.random() < 0.4,
        body=body,
        shell=shell,
    )


def hang_lamps(stage: Stage, wardrobe: Wardrobe, hall: Hall) -> Floats:
    """Hangs one to four lines of lamps of a style, a few of them switched off; places (L, 3) below those that shine
    near the camera."""
    rng = stage.rng
    style = random_style(rng, wardrobe)
    y = hall.height - float(rng.uniform(0.01, max(0.05, min(2.2, hall.height - 3.2)))) - style.thick
    dark = float(rng.choice([0.0, 0.0, 0.06, 0.3]))
    places: list[tuple[float, float, float]] = []
    spacing = float(rng.uniform(1.2, 6.0))
    middle = float(rng.normal(0, 0.7))
    for line in range(int(rng.integers(1, 5))):
        z = middle + (line + 1) // 2 * (-1 if line % 2 else 1) * spacing
        if abs(z) > hall.across - 0.5:
            continue
        places += _line(stage, replace(style, body=style.body.tinted(_uneven(rng, style.body))), hall, (y, z), dark)
    places.sort(key=lambda place: abs(place[0]) + abs(place[2]))
    return np.array(places[:12]).reshape(-1, 3)


def _uneven(rng: Random, surface: Surface) -> tuple[float, float, float]:
    factor = float(np.exp(rng.normal(0, 0.12)))
    red, green, blue = surface.tint
    return red * factor, green * factor, blue * factor


def _line(
    stage: Stage, style: Style, hall: Hall, at: tuple[float, float], dark: float
) -> list[tuple[float, float, float]]:
    """One line of lamps along x at a height and z; it may begin or end in sight, and lack a lamp."""
    rng = stage.rng
    y, z = at
    step = (style.wide if style.across else style.long) + style.gap
    start = -hall.along + float(rng.uniform(0, step)) if rng.random() < 0.7 else float(rng.uniform(-6, 1))
    end = hall.along if rng.random() < 0.7 else float(rng.uniform(1, 8))
    places = []
    off = replace(style, body=Surface(style.shell.tile, grey(rng, 0.2, 0.8)))
    for x in np.arange(start, end - step, step):
        if rng.random() < 0.02:
            continue
        shines = rng.random() >= dark
        with stage.frame((float(x) + step / 2, y, z), 90.0 if style.across else 0.0):
            build_lamp(stage, style if shines else off, LIGHT if shines else 0, hall.height - y)
        if shines:
            places.append((float(x) + step / 2, y - 0.35, z))
    return places


def build_lamp(stage: Stage, style: Style, label: int, above: float) -> None:
    """A lamp about the present frame's origin, along x, its lower side at y = 0, `above` metres below the roof."""
    half, wide = style.long / 2, style.wide / 2
    tag = Tag(label, _JUDGED * style.wide)
    if style.kind == "disc":
        _disc(stage, style, tag)
    elif style.tubes:
        for side in (-1, 1):
            low, high = (-half, 0.0, side * wide * 0.6 - 0.015), (half, 0.03, side * wide * 0.6 + 0.015)
            stage.box(low, high, style.body, tag=Tag(label, _JUDGED * 0.03))
        stage.box((-half, 0.035, -wide * 1.5), (half, 0.06, wide * 1.5), style.shell)
    else:
        stage.box((-half, 0.0, -wide), (half, style.thick, wide), style.body, tag=tag)
    if style.case and not style.tubes:
        out = wide * style.case
        stage.box((-half * 1.01, style.thick, -out), (half * 1.01, style.thick + 0.05, out), style.shell)
    if style.rods and above > 0.2:
        for x in (-half * 0.7, half * 0.7):
            stage.box((x, style.thick, -0.006), (x + 0.012, above, 0.006), style.shell)


def _disc(stage: Stage, style: Style, tag: Tag) -> None:
    """A round lamp, its lower side a polygon, with a bell or a flat can above it."""
    corners = [(0.5 + 0.5 * math.cos(a), 0.5 + 0.5 * math.sin(a)) for a in np.linspace(0, 2 * math.pi, 13)[:-1]]
    size = style.long
    stage.polygon((-size / 2, 0.0, -size / 2), (size, 0, 0), (0, 0, size), corners, style.body, tag=tag)
    can = size / 2 * 1.05
    stage.cylinder((0.0, 0.005, 0.0), can, 0.08 + 0.3 * style.case / 2.5, style.shell, style.shell)
