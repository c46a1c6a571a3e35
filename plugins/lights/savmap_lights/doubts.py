"""What is implausible about mapped lamps: heights that disagree, lengths, gaps in a regular line, ends that were never seen."""

from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np

from savmap.plugin import Doubt, Floats, Structure

UNKNOWN_M = 1000.0
"""The standard deviation of what is not known: of a strip's end that no frame showed, along the strip."""

LIGHT_BEYOND, LIGHT_BEFORE = "light beyond, x m", "light before, x m"
LIGHT_OFTEN = "light beyond, share of its neighbours' frames"
"""The attributes of a lamp that tell where, before the next one, and of the first one, before it, something shines that no lamp explains; in how many frames
for each one that shows the lamps on either side, the light before the next one was seen."""
SIDES, SIDES_NOT_SEEN = "sides", "not seen"
"""The attribute of a compact lamp, and its value where the brightness falls around it in at most a quarter of the frames."""

FEWEST, FEWEST_STEPS, FEWEST_ALIKE = 4, 2, 3
OFF_SIGMA, OFF_M = 4.0, 0.03
REGULAR, MOST = 0.05, 0.75
GAP = 1.5
OFTEN = 0.75
LONGER = 1.3
NEARER = 0.5
NEAR_PITCH = 0.2


def doubts_of(lamps: Sequence[Structure]) -> list[Doubt]:
    """Doubts about the lamps of one row."""
    ordered = sorted(lamps, key=lambda lamp: float(lamp.vertices[:, 0].mean()))
    whole = [lamp for lamp in ordered if is_whole(lamp)]
    return [
        *_heights(whole),
        *_lengths(whole),
        *_parts(whole),
        *_gaps(ordered),
        *_next_in_line(ordered),
        *_unexplained(ordered),
        *_alone(ordered),
        *_open(ordered),
        *_without_sides(ordered),
    ]


def is_whole(lamp: Structure) -> bool:
    """Whether all of a lamp's ends were seen."""
    return bool((np.diagonal(lamp.covariances, axis1=1, axis2=2) < (UNKNOWN_M / 2) ** 2).all())


def _middle(lamp: Structure) -> tuple[float, float, float]:
    x, y, z = lamp.vertices.mean(axis=0).tolist()
    return x, y, z


def _where(*lamps: Structure) -> tuple[tuple[str, ...], tuple[float, float, float]]:
    """The ids of lamps, and the place of the first one."""
    return tuple(lamp.id for lamp in lamps), _middle(lamps[0])


def _heights(lamps: Sequence[Structure]) -> Iterator[Doubt]:
    """A lamp with a vertex at another height than the others, further off than its uncertainty explains."""
    if len(lamps) < FEWEST:
        return
    usual = float(np.median([lamp.vertices[:, 1].mean() for lamp in lamps]))
    for lamp in lamps:
        heights = lamp.vertices[:, 1]
        sigmas = np.sqrt(lamp.covariances[:, 1, 1])
        off = np.abs(heights - usual) - np.maximum(OFF_SIGMA * sigmas, OFF_M)
        if off.max() > 0:
            height = float(heights[off.argmax()])
            figure, action = f"{height:.2f} m, others {usual:.2f} m", f"look whether it is one of this row: {lamp.id}"
            yield Doubt("shape", "a lamp has an unusual height", *_where(lamp), figure=figure, action=action)


def _lengths(lamps: Sequence[Structure]) -> Iterator[Doubt]:
    """A strip longer or shorter than the others.

    Where most strips are equal, each that differs from these is doubted. Where most are not, but at least three are, a strip is doubted if no
    other has its length: a second kind of lamp comes more than once, a part of a strip does not. The verdict makes a note of a doubt beyond
    the row's ends, where joints may not show from afar.
    """
    strips = [lamp for lamp in lamps if len(lamp.vertices) == 2]
    lengths = np.array([np.linalg.norm(lamp.vertices[1] - lamp.vertices[0]) for lamp in strips])
    if len(strips) < FEWEST:
        return
    alike = (np.abs(lengths - lengths[:, None]) < REGULAR * np.maximum(lengths, lengths[:, None])).sum(axis=1)
    regular = _are_regular(lengths)
    if not regular and alike.max() < FEWEST_ALIKE:
        return
    usual = float(np.median(lengths)) if regular else float(lengths[alike.argmax()])
    for lamp, length, likes in zip(strips, lengths.tolist(), alike.tolist(), strict=True):
        if not 1 / LONGER < length / usual < LONGER and (regular or likes == 1):
            figure, action = f"{length:.2f} m, others {usual:.2f} m", f"look at its ends and joints: {lamp.id}"
            yield Doubt("shape", "a lamp has an unusual length", *_where(lamp), figure=figure, action=action)


def _parts(lamps: Sequence[Structure]) -> Iterator[Doubt]:
    """Two neighbours that may be parts of one strip: together they are as long as each of at least three others, and the gap between them is less than half
    of the least gap between those."""
    strips = [lamp for lamp in lamps if len(lamp.vertices) == 2]
    extents = np.array([np.sort(lamp.vertices[:, 0]) for lamp in strips]).reshape(-1, 2)
    lengths, gaps = np.diff(extents, axis=1)[:, 0], extents[1:, 0] - extents[:-1, 1]
    for k, (one, other) in enumerate(pairwise(strips)):
        together = float(extents[k + 1, 1] - extents[k, 0])
        alike = np.abs(lengths - together) < REGULAR * together
        between = gaps[alike[1:] & alike[:-1]]
        if alike.sum() >= FEWEST_ALIKE and len(between) and gaps[k] < NEARER * between.min():
            figure = f"{together:.2f} m together, as {alike.sum()} others"
            action = f"look whether they are parts of one: {one.id} and {other.id}"
            yield Doubt("shape", "two lamps may be one", *_where(one, other), figure=figure, action=action)


def _gaps(lamps: Sequence[Structure]) -> Iterator[Doubt]:
    """A gap in a line of lamps that is regular but for it, and in which something shines. A dark one is a lamp that is out, or none."""
    x = np.array([lamp.vertices[:, 0].mean() for lamp in lamps if is_whole(lamp)])
    steps = np.diff(x)
    if len(steps) < FEWEST or not _are_regular(steps):
        return
    usual = float(np.median(steps))
    for before, after in pairwise(lamps):
        step = float(after.vertices[:, 0].mean() - before.vertices[:, 0].mean())
        if is_whole(before) and is_whole(after) and step > GAP * usual and LIGHT_BEYOND in before.attributes:
            figure = f"{step:.2f} m apart, others {usual:.2f} m"
            action = f"look at what shines between: {before.id} and {after.id}"
            yield Doubt("shape", "a lamp may be missing in a gap", *_where(before, after), figure=figure, action=action)


def _next_in_line(lamps: Sequence[Structure]) -> Iterator[Doubt]:
    """Light where the next lamp of a regular line would be, beyond the last one or before the first. That is where something was seen, so no
    structure is named: beyond the row's ends it is no doubt."""
    whole = [lamp for lamp in lamps if is_whole(lamp)]
    steps = np.diff([_middle(lamp)[0] for lamp in whole])
    if len(steps) < FEWEST_STEPS or not (np.abs(steps - np.median(steps)) < REGULAR * np.median(steps)).all():
        return
    usual = float(np.median(steps))
    for lamp, attribute, way in ((whole[0], LIGHT_BEFORE, -1), (whole[-1], LIGHT_BEYOND, 1)):
        x, y, z = _middle(lamp)
        place = float(lamp.attributes.get(attribute, np.inf))
        if lamp in (lamps[0], lamps[-1]) and abs(place - x - way * usual) < REGULAR * usual:
            figure, action = f"at x {place:.2f} m", f"look at what shines beside: {lamp.id}"
            yield Doubt("shape", "a lamp of the line may be missing", (), (place, y, z), figure=figure, action=action)


def _unexplained(lamps: Sequence[Structure]) -> Iterator[Doubt]:
    """Light between lamps of an irregular line that was seen about as often as they were: no pitch tells whether one belongs there. Where all
    steps are multiples of one pitch, as where lamps are out, one belongs at multiples of it only."""
    x = np.array([lamp.vertices[:, 0].mean() for lamp in lamps if is_whole(lamp)])
    steps = np.diff(x)
    if len(x) > FEWEST and _are_regular(steps):
        return
    pitch = _pitch(steps)
    for before, after in pairwise(lamps):
        if float(before.attributes.get(LIGHT_OFTEN, 0.0)) < OFTEN:
            continue
        place = float(before.attributes[LIGHT_BEYOND])
        along, y, z = _middle(before)
        if pitch is None or abs(_off_multiple(place - along, pitch)) < NEAR_PITCH * pitch:
            figure, action = f"at x {place:.2f} m", f"look at what shines between: {before.id} and {after.id}"
            yield Doubt(
                "shape",
                "something shines that is no mapped lamp",
                (before.id, after.id),
                (place, y, z),
                figure=figure,
                action=action,
            )


def _pitch(steps: Floats) -> float | None:
    """The pitch of a line, m: its least step, if at least three steps are equal to it and all steps are multiples of it; None otherwise."""
    if len(steps) < FEWEST:
        return None
    pitch = float(np.median(steps[steps < (1 + REGULAR) * steps.min()]))
    once = np.abs(steps - pitch) < REGULAR * pitch
    multiples = np.abs(_off_multiple(steps, pitch)) < REGULAR * pitch
    return pitch if once.sum() >= FEWEST_ALIKE and multiples.all() else None


def _off_multiple(steps: Floats | float, pitch: float) -> Floats:
    """How far steps are off the nearest multiple of a pitch, m."""
    return np.asarray(steps - pitch * np.round(np.asarray(steps) / pitch))


def _alone(lamps: Sequence[Structure]) -> Iterator[Doubt]:
    """Light beside the only lamp of a row that was seen about as often as that was."""
    if len(lamps) == 1 and float(lamps[0].attributes.get(LIGHT_OFTEN, 0.0)) >= OFTEN:
        (lamp,), place = lamps, float(lamps[0].attributes[LIGHT_BEYOND])
        figure, action = f"at x {place:.2f} m", f"look at what shines beside the only lamp: {lamp.id}"
        yield Doubt(
            "shape",
            "something shines that is no mapped lamp",
            (lamp.id,),
            (place, *_middle(lamp)[1:]),
            figure=figure,
            action=action,
        )


def _are_regular(sizes: Floats) -> bool:
    usual = float(np.median(sizes))
    return bool((np.abs(sizes - usual) < REGULAR * usual).mean() >= MOST)


def _open(lamps: Sequence[Structure]) -> Iterator[Doubt]:
    """A strip between others, one of whose ends no frame showed."""
    for lamp in lamps[1:-1]:
        if not is_whole(lamp):
            yield Doubt("shape", "a lamp's end was never seen", *_where(lamp), action=f"look for its end: {lamp.id}")


def _without_sides(lamps: Sequence[Structure]) -> Iterator[Doubt]:
    """A compact lamp whose sides do not show: what is around it is as bright, as in a skylight or on an overexposed ceiling."""
    for lamp in lamps:
        if lamp.attributes.get(SIDES) == SIDES_NOT_SEEN:
            action = f"look whether it is a lamp, or a part of a skylight: {lamp.id}"
            yield Doubt("shape", "a lamp's sides do not show", *_where(lamp), action=action)
