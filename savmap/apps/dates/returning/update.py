"""An earlier map with what another pass showed, and a pass's map in the frame of the row that it shows.

Both maps are in the row's frame, and the pass is laid onto the earlier map as the comparison of both says. What both
have and no test tells apart is where both together put it, by covariance intersection (Julier and Uhlmann 1997, weights
by traces as of Niehsen 2002): the pass has its frame from the map, so that their errors go together by an unknown
amount. What moved or changed is as the pass shows it; what is missing goes; what the camera did not pass stays. Labels
are those of the earlier map.
"""

import re
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np

from savmap.apps.dates.comparison.compare import LEVEL, compare_maps
from savmap.apps.dates.comparison.records import Comparison, ElementChange, RowComparison, RowMotion
from savmap.errors import StructureError
from savmap.types import (
    Attribute,
    Floats,
    JointCovariance,
    Measured,
    RowMap,
    RowPlace,
    SiteMap,
    Structure,
    Trajectory,
    Verdict,
)

LAST_NUMBER = re.compile(r"\d+$")
PART = re.compile(r"(\D*?)\s*(\d+)$")
SAME_PLACE_M, UNMEASURED_M = 0.5, 0.15
SIGMA, METRES = "_sigma_m", "_m"
Names = Mapping[str, Mapping[str, str]]
"""By plugin, what structures of a pass are called in the map, by what they are called in the pass."""


def updated(
    earlier: SiteMap,
    passes: Mapping[str, RowMap],
    made_by: Mapping[str, str],
    level: float = LEVEL,
) -> tuple[SiteMap, Comparison]:
    """The earlier map with passes of its rows, by name, each in that row's frame, and how these rows differ. Raises
    StructureError where a pass fits another place of its row better."""
    rows = {name: earlier.rows[name] for name in passes}
    comparison = compare_maps(SiteMap(rows, {}), SiteMap(passes, {}), level=level)
    compared = tuple(replace(row, motion=_motion(row)) for row in comparison.rows)
    names = {row.new: _names(row, earlier.rows[row.new]) for row in compared}
    laid = {row.new: laid_onto(passes[row.new], _motion(row)) for row in compared}
    mapped = {row.new: _updated(earlier.rows[row.new], laid[row.new], row, names[row.new]) for row in compared}
    site_map = replace(earlier, rows={**earlier.rows, **mapped}, made_by=made_by, failed={})
    renamed = []  # the comparison with the map's labels of what the pass showed
    for row in compared:
        of_row = names[row.new]
        ids = [change.new_id and of_row[change.plugin][change.new_id] for change in row.elements]
        elements = (replace(change, new_id=new_id) for change, new_id in zip(row.elements, ids, strict=True))
        renamed.append(replace(row, elements=tuple(elements)))
    return site_map, replace(comparison, rows=tuple(renamed))


def _motion(row: RowComparison) -> RowMotion:
    """How the rows, which are in one frame, lie in one another: at no other place. Raises StructureError where another
    one fits better."""
    if row.motion is None or abs(float(row.motion.shift_m[0])) > SAME_PLACE_M:
        raise StructureError(
            f"row {row.new}: the pass was recognised at one place of the row and fits another one better: too much "
            "has changed; map it without --against"
        )
    return replace(row.motion, alternatives_m=())


def _names(row: RowComparison, earlier: RowMap) -> Names:
    """Labels of the pass's structures: those of their partners, and new ones that count on from the map's."""
    names: dict[str, dict[str, str]] = {plugin: {} for plugin in earlier.structures}
    for change in row.elements:
        if change.new_id is not None and change.old_id is not None:
            names.setdefault(change.plugin, {})[change.new_id] = change.old_id
    for plugin in {change.plugin for change in row.elements}:
        taken = {part.id for part in earlier.structures.get(plugin, ())}
        groups = _groups(names.setdefault(plugin, {}))
        for change in row.elements:
            if change.plugin == plugin and change.old_id is None and change.new_id is not None:
                name = _free_name(change.new_id, groups, taken)
                names[plugin][change.new_id] = name
                taken.add(name)
    return names


def _groups(names: Mapping[str, str]) -> dict[str, str]:
    """What a group of structures is called in the map ("bay 4" of "bay 4 / beam 2"), by what it is called in the pass,
    as most of its members say."""
    votes: dict[str, Counter[str]] = {}
    for here, label in names.items():
        group, _, _ = here.rpartition(" / ")
        votes.setdefault(group, Counter())[label.rpartition(" / ")[0]] += 1
    return {group: counts.most_common(1)[0][0] for group, counts in votes.items()}


def _free_name(name: str, groups: dict[str, str], taken: set[str]) -> str:
    """A label for what the map has not: in its group, with the next number that is free there. A group that the map has
    not either is numbered on as a whole, and put into `groups`."""
    group, separator, last = name.rpartition(" / ")
    if separator and group not in groups:
        heads = {other.rpartition(" / ")[0] for other in taken}
        number = 1 + max((int(match[2]) for head in heads if (match := PART.match(head))), default=0)
        groups[group] = LAST_NUMBER.sub(str(number), group)
    start = f"{groups.get(group, group)}{separator}"
    stem = LAST_NUMBER.sub("", last)
    numbers = [
        int(other[len(start) + len(stem) :])
        for other in taken
        if other.startswith(start + stem) and other[len(start) + len(stem) :].isdigit()
    ]
    return f"{start}{stem}{1 + max(numbers, default=0)}"


def _updated(earlier: RowMap, row: RowMap, compared: RowComparison, names: Names) -> RowMap:
    """The mapped row with what a pass showed; frames, path, references and verdict are the pass's."""
    kept: dict[str, list[Structure]] = {plugin: [] for plugin in {**earlier.structures, **row.structures}}
    same: dict[str, set[str]] = {}
    before, after = (
        {(plugin, part.id): part for plugin, group in of.structures.items() for part in group} for of in (earlier, row)
    )
    for change in compared.elements:
        structure = _confirmed_or_new(change, before, after, names)
        if structure is not None:
            kept[change.plugin].append(structure)
            if change.old_id is not None and change.state in ("same", "not seen"):
                same.setdefault(change.plugin, set()).add(structure.id)
    renamed = {here: label for group in names.values() for here, label in group.items()}
    order = {key: number for number, key in enumerate(before)}
    return replace(
        row,
        structures={
            plugin: tuple(sorted(group, key=lambda part: order.get((plugin, part.id), len(order))))  # new ones last
            for plugin, group in kept.items()
        },
        references=tuple(replace(use, name=_in_words(use.name, renamed)) for use in row.references),
        report={
            key: _in_words(value, renamed) if isinstance(value, str) else value for key, value in row.report.items()
        },
        verdict=_verdict(earlier.verdict, row.verdict, renamed, compared),
        joint=_joint(earlier.joint, same),
    )


def _confirmed_or_new(
    change: ElementChange,
    earlier: Mapping[tuple[str, str], Structure],
    row: Mapping[tuple[str, str], Structure],
    names: Names,
) -> Structure | None:
    """What the updated map has of an element; None where it is missing now."""
    if change.new_id is None:
        old = earlier[change.plugin, change.old_id or ""]
        return old if change.state == "not seen" else None
    new = _relabelled(row[change.plugin, change.new_id], names[change.plugin][change.new_id])
    if change.old_id is None:
        return new
    old = earlier[change.plugin, change.old_id]
    new = replace(new, attributes={**new.attributes, **_numbers(old)})
    return _joined(old, new) if change.state == "same" else new


def _relabelled(structure: Structure, name: str) -> Structure:
    """A structure, its vertices and its numbers with the label that the map gives it."""
    labels = tuple(
        name + label.removeprefix(structure.id) if label.startswith(structure.id) else label
        for label in structure.vertex_labels
    )
    numbers = {
        match[1]: int(match[2])
        for part in name.split(" / ")
        if (match := PART.match(part)) and isinstance(structure.attributes.get(match[1]), int)
    }
    return replace(structure, id=name, vertex_labels=labels, attributes={**structure.attributes, **numbers})


def _numbers(structure: Structure) -> dict[str, Attribute]:
    """The attributes that number a structure, as its label does: `bay` and `beam` of "bay 4 / beam 2"."""
    named = {match[1] for part in structure.id.split(" / ") if (match := PART.match(part))}
    return {key: value for key, value in structure.attributes.items() if key in named}


def _joined(old: Structure, new: Structure) -> Structure:
    """An element where both maps together put it."""
    if old.vertex_labels != new.vertex_labels:
        return new
    base = old if _unmeasured(old) < _unmeasured(new) else new
    vertices, covariances = old.vertices.copy(), old.covariances.copy()
    for k in range(len(vertices)):
        traces = [float(np.trace(of.covariances[k])) for of in (old, new)]
        weight = traces[1] / sum(traces)
        before, after = (np.linalg.inv(of.covariances[k]) for of in (old, new))
        covariances[k] = np.linalg.inv(weight * before + (1 - weight) * after)
        of_both = weight * before @ old.vertices[k] + (1 - weight) * after @ new.vertices[k]
        vertices[k] = covariances[k] @ of_both
    solid = base.solid
    if solid is not None:
        solid = replace(solid, outline=solid.outline + (vertices - base.vertices).mean(axis=0))
    attributes = {**base.attributes, **dict(_joined_figures(old, new))}
    return replace(base, vertices=vertices, covariances=covariances, attributes=attributes, solid=solid)


def _unmeasured(structure: Structure) -> int:
    """How many coordinates of its vertices were hardly measured."""
    return int((np.diagonal(structure.covariances, axis1=1, axis2=2) > UNMEASURED_M**2).sum())


def _joined_figures(old: Structure, new: Structure) -> Iterator[tuple[str, Attribute]]:
    """Lengths with a standard deviation that both have."""
    for key, value in new.attributes.items():
        before = old.attributes.get(key)
        if isinstance(value, Measured) and isinstance(before, Measured):
            yield key, Measured(*_joined_figure((before.value, before.sigma), (value.value, value.sigma)))
        sigma = f"{key.removesuffix(METRES)}{SIGMA}"
        pair = [
            (float(figures[key]), float(figures[sigma]))
            for figures in (old.attributes, new.attributes)
            if isinstance(figures.get(key), float) and isinstance(figures.get(sigma), float)
        ]
        if key.endswith(METRES) and len(pair) == 2:
            yield from zip((key, sigma), _joined_figure(*pair), strict=True)


def _joined_figure(before: tuple[float, float], after: tuple[float, float]) -> tuple[float, float]:
    """Value and standard deviation of two estimates of a number."""
    variances = before[1] ** 2, after[1] ** 2
    weight = variances[1] / max(sum(variances), 1e-18)
    shares = weight / max(variances[0], 1e-18), (1 - weight) / max(variances[1], 1e-18)
    value = (shares[0] * before[0] + shares[1] * after[0]) / sum(shares)
    return float(value), float(1 / np.sqrt(sum(shares)))


def _joint(joint: JointCovariance | None, same: Mapping[str, set[str]]) -> JointCovariance | None:
    """The earlier map's joint covariance of what is as it was. Of what is new, nothing is known in common."""
    if joint is None:
        return None
    coordinates = {
        plugin: {name: numbers for name, numbers in group.items() if name in same.get(plugin, ())}
        for plugin, group in joint.coordinates.items()
    }
    return replace(joint, coordinates=coordinates)


def _verdict(
    earlier: Verdict | None, new: Verdict | None, renamed: Mapping[str, str], compared: RowComparison
) -> Verdict | None:
    """The pass's verdict, with what the earlier one says of elements that the pass did not see."""
    if new is None:
        return earlier
    unseen = {change.old_id for change in compared.elements if change.state == "not seen"}
    of_unseen = [
        warning
        for warning in (earlier.warnings if earlier else ())
        if not warning.of_row and unseen.issuperset(warning.subjects)
    ]
    warnings = [
        replace(
            warning,
            subjects=tuple(_in_words(name, renamed) for name in warning.subjects),
            details=tuple(_in_words(line, renamed) for line in warning.details),
        )
        for warning in new.warnings
    ]
    notes = tuple(_in_words(note, renamed) for note in new.notes)
    return Verdict(tuple(dict.fromkeys((*warnings, *of_unseen))), notes)


def _in_words(text: str, renamed: Mapping[str, str]) -> str:
    """A text with the map's labels."""
    if not renamed:
        return text
    longest = sorted(renamed, key=len, reverse=True)
    pattern = "|".join(rf"{re.escape(name)}(?!\d)" for name in longest)
    return re.sub(pattern, lambda match: renamed[match[0]], text)


def in_row(row: RowMap, place: RowPlace, mapped: RowMap) -> RowMap:
    """A pass that was solved in metres, moved along x into the mapped row's frame, with that row's name: by the median
    distance of what is in both."""
    here, other = ({(p, s.id): s for p, group in of.structures.items() for s in group} for of in (row, mapped))
    off = [
        _middle_x(other[plugin, theirs]) - _middle_x(here[plugin, ours])
        for plugin, ours, theirs in place.pairs
        if (plugin, ours) in here
    ]
    return moved(replace(row, name=place.row), np.eye(3), np.array([float(np.median(off)), 0.0, 0.0]))


def _middle_x(structure: Structure) -> float:
    return float((structure.vertices[:, 0].min() + structure.vertices[:, 0].max()) / 2)


def laid_onto(row: RowMap, motion: RowMotion) -> RowMap:
    """A pass laid onto the mapped row by what a comparison says of how that row's frame lies in the pass's, of which
    little is left: millimetres, and tenths of a percent."""
    origin, *axes = motion.points(np.vstack([np.zeros(3), np.eye(3)]))
    row_from_mapped = np.array(axes).T - origin[:, None]
    linear = np.linalg.inv(row_from_mapped)
    return moved(row, linear, -linear @ origin)


def moved(row: RowMap, linear: Floats, shift_m: Floats) -> RowMap:
    """A row whose points p are at linear (3, 3) p + shift (3,) m. The linear part is nearly the identity: covariances
    and the camera's attitudes stay."""
    poses = row.trajectory.world_from_rig.copy()
    poses[:, :3, 3] = poses[:, :3, 3] @ linear.T + shift_m
    face = row.face
    return replace(
        row,
        trajectory=Trajectory(row.trajectory.frames, poses, row.trajectory.sigma_m),
        structures={
            name: tuple(_moved(part, linear, shift_m) for part in group) for name, group in row.structures.items()
        },
        face=None if face is None else replace(face, origin=linear @ face.origin + shift_m),
        verdict=None if row.verdict is None else _shifted(row.verdict, shift_m),
    )


def _moved(structure: Structure, linear: Floats, shift_m: Floats) -> Structure:
    solid = structure.solid
    return replace(
        structure,
        vertices=structure.vertices @ linear.T + shift_m,
        solid=None if solid is None else replace(solid, outline=solid.outline @ linear.T + shift_m),
    )


def _shifted(verdict: Verdict, shift_m: Floats) -> Verdict:
    """A verdict whose warnings are about other places."""
    warnings = []
    for warning in verdict.warnings:
        if warning.place is not None:
            x, y, z = (shift_m + np.array(warning.place)).tolist()
            warning = replace(warning, place=(x, y, z))
        warnings.append(warning)
    return replace(verdict, warnings=tuple(warnings))
