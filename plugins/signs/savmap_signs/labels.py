"""Audit of location labels: whether each hangs where its number belongs.

The numbers of a row's labels are taken to go up or down in even steps along the bays, the levels and the places on a
level. Which steps these are, most labels tell, by a vote; the others hang elsewhere than they should.
"""

import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from savmap.types import Finding, FindingTable, RowInspection, Structure
from savmap.types.inspection import SURE, Cell, Grade
from savmap_signs.mapping import AT_FACE_M
from savmap_signs.settings import LABEL_GROUPS as GROUPS
from savmap_signs.settings import SignsLimits

STEPS = (1, -1, 2, -2, 10, -10, 5, -5)
"""By which numbers of neighbours may differ; the first are preferred."""
LEAST_AGREE = 0.5
"""Of the labels that must agree on the numbering, else nothing is told."""
LEAST_READ = 0.8
"""Of the labels of a level that must have been read before one that was not is called missing."""
Index = tuple[int, int, int]
"""Bay and level of the map, and the place on the level from the left, from 0."""
Numbers = tuple[int, ...]


@dataclass(frozen=True, eq=False)
class Label:
    """A location label: its sign, what was read, its numbers, and where it hangs."""

    sign: Structure
    match: re.Match[str]
    numbers: Numbers
    index: Index

    @property
    def confidence(self) -> float:
        """Of its reading."""
        return float(self.sign.attributes.get("confidence", 1.0))


@dataclass(frozen=True)
class Numbering:
    """First number and step of each group of the labels, in the order of `groups`."""

    groups: tuple[str, ...]
    starts: Numbers
    steps: Numbers

    def at(self, index: Index) -> Numbers:
        """The numbers that belong somewhere."""
        places = (index[GROUPS.index(group)] for group in self.groups)
        return tuple(start + step * place for start, step, place in zip(self.starts, self.steps, places, strict=True))


def audit(
    signs: Sequence[Structure],
    places: Sequence[Structure],
    limits: SignsLimits,
    others: Mapping[str, Sequence[Structure]],
) -> RowInspection:
    """Labels that are missing, double, swapped or hang elsewhere than they should, and a table of which label hangs at
    which slot. `places`: those of the row, of which slots have the attributes `bay` and `level`; `others`: the signs of
    the other rows."""
    if limits.pattern is None:
        return RowInspection(unchecked=("location labels: no `pattern` is among the limits",))
    slots = {
        (bay, level): slot
        for slot in places
        if (bay := _whole(slot, "bay")) and (level := _whole(slot, "level")) is not None
    }
    labels = labels_of(signs, slots, re.compile(limits.pattern))
    numbering = numbering_of(labels)
    if numbering is None:
        line = (
            "location labels: no text matches the pattern"
            if not labels
            else "location labels: their numbers follow no order"
        )
        return RowInspection(tables=(_table(labels, None, {}),), unchecked=(line,), applied=("pattern",))
    findings, states = list[Finding](), dict[str, str]()
    for state, named, finding in _displaced(labels, numbering):
        findings.append(finding)
        states |= dict.fromkeys((label.sign.id for label in named), state)
    elsewhere = _in_other_rows(labels, others)
    missing, unread = _missing(labels, slots, numbering)
    if len(elsewhere) > LEAST_AGREE * len(labels):
        unread.append("labels that hang in two rows: most do, the pattern names no row")
        elsewhere = {}
    for sign_id, finding in elsewhere.items():
        if states.setdefault(sign_id, "double") == "double":
            findings.append(finding)
    tables = (_table(labels, numbering, states),)
    return RowInspection((*findings, *missing), tables, (), tuple(unread), ("pattern",))


def _whole(place: Structure, name: str) -> int | None:
    value = place.attributes.get(name)
    return int(value) if isinstance(value, int | np.integer) else None


Slots = Mapping[tuple[int, int], Structure]


def labels_of(signs: Sequence[Structure], slots: Slots, pattern: re.Pattern[str]) -> list[Label]:
    """The signs at the face whose text is a label's, in front of a slot."""
    read = [(sign, pattern.fullmatch(str(sign.attributes.get("text", "")))) for sign in signs]
    matched = [(sign, match) for sign, match in read if match and abs(sign.vertices[:, 2].mean()) <= AT_FACE_M]
    numbers = [tuple(_number(match[group]) for group in _groups(match)) for _, match in matched]
    side_by_side = len({match["position"] for _, match in matched}) if "position" in pattern.groupindex else 1
    labels = []
    for (sign, match), of_label in zip(matched, numbers, strict=True):
        slot = _slot_of(sign, slots)
        if slot is not None:
            left, right = slots[slot].vertices[:, 0].min(), slots[slot].vertices[:, 0].max()
            share = (float(sign.vertices[:, 0].mean()) - left) / (right - left)
            labels.append(Label(sign, match, of_label, (*slot, int(share * side_by_side))))
    return labels


def _groups(match: re.Match[str]) -> tuple[str, ...]:
    return tuple(group for group in GROUPS if group in match.re.groupindex)


def _number(text: str) -> int:
    """A text of digits as a number; of letters, A is 1, Z 26 and AA 27."""
    if text.isdecimal():
        return int(text)
    number = 0
    for letter in text.upper():
        number = 26 * number + ord(letter) - ord("A") + 1
    return number


def _written(number: int, like: str) -> str:
    """A number as a text of the same kind: digits of the same width, or letters."""
    if like.isdecimal():
        return str(number).zfill(len(like))
    letters = ""
    while number > 0:
        number, rest = divmod(number - 1, 26)
        letters = chr(ord("A") + rest) + letters
    return letters if like.isupper() else letters.lower()


def _slot_of(sign: Structure, slots: Slots) -> tuple[int, int] | None:
    """Bay and level in front of which a sign hangs: of the bay's levels the lowest that ends above it."""
    x, y, _ = sign.vertices.mean(axis=0)
    inside = sorted(
        (key[1], key) for key, slot in slots.items() if slot.vertices[:, 0].min() <= x < slot.vertices[:, 0].max()
    )
    keys = [key for _, key in inside]
    return next((key for key in keys if slots[key].vertices[:, 1].max() > y), keys[-1] if keys else None)


def numbering_of(labels: Sequence[Label]) -> Numbering | None:
    """The numbering on which most labels agree; None where too few do."""
    if not labels:
        return None
    groups = _groups(labels[0].match)
    votes = [
        Counter(
            (label.numbers[k] - step * label.index[GROUPS.index(group)], step) for label, step in product(labels, STEPS)
        )
        for k, group in enumerate(groups)
    ]
    best = [max(counts, key=lambda vote: (counts[vote], -STEPS.index(vote[1]))) for counts in votes]
    numbering = Numbering(groups, tuple(start for start, _ in best), tuple(step for _, step in best))
    agree = sum(label.numbers == numbering.at(label.index) for label in labels)
    return numbering if agree > LEAST_AGREE * len(labels) else None


Displaced = tuple[str, tuple[Label, ...], Finding]


def _displaced(labels: Sequence[Label], numbering: Numbering) -> Iterator[Displaced]:
    """What hangs where another number belongs, and what hangs twice: a word, the labels, the finding."""
    right = {label.numbers: label for label in labels if label.numbers == numbering.at(label.index)}
    wrong = [label for label in labels if label.numbers != numbering.at(label.index)]
    reported: set[str] = set()
    for label in wrong:
        wanted = numbering.at(label.index)
        partner = next(
            (other for other in wrong if other.numbers == wanted and numbering.at(other.index) == label.numbers), None
        )
        if label.sign.id in reported:
            continue
        if partner is not None:
            reported.add(partner.sign.id)
            yield (
                "swapped",
                (label, partner),
                _finding("label-swapped", f"{_text(label)} and {_text(partner)} are swapped", label, partner),
            )
        elif label.numbers in right:
            twin = right[label.numbers]
            yield (
                "double",
                (label,),
                _finding(
                    "label-double",
                    f"{_text(label)} hangs twice, once where {_named(label, wanted)} belongs",
                    label,
                    twin,
                ),
            )
        else:
            yield (
                "misplaced",
                (label,),
                _finding("label-misplaced", f"{_text(label)} hangs where {_named(label, wanted)} belongs", label),
            )
    for label in labels:
        if label.numbers in right and right[label.numbers] is not label and label not in wrong:
            yield (
                "double",
                (label,),
                _finding("label-double", f"{_text(label)} hangs twice at one place", label, right[label.numbers]),
            )


def _in_other_rows(labels: Sequence[Label], others: Mapping[str, Sequence[Structure]]) -> dict[str, Finding]:
    """A finding for each label that hangs in another row, too, by its sign's id."""
    rows: dict[str, list[tuple[str, float]]] = {}
    for row, signs in others.items():
        for sign in signs:
            read = str(sign.attributes.get("text", "")), float(sign.attributes.get("confidence", 1.0))
            rows.setdefault(read[0], []).append((row, read[1]))
    findings = {}
    for label in labels:
        for row, confidence in rows.get(label.match[0], ())[:1]:
            finding = _finding("label-double", f"{_text(label)} hangs in row {row}, too", label)
            probability = label.confidence * confidence
            grade: Grade = "red" if probability > SURE else "amber"
            findings[label.sign.id] = replace(finding, probability=probability, grade=grade)
    return findings


def _text(label: Label) -> str:
    return f'"{label.match[0]}"'


def _named(like: Label, numbers: Numbers) -> str:
    """The text of a label with other numbers."""
    text = like.match[0]
    for group, number in sorted(
        zip(_groups(like.match), numbers, strict=True), key=lambda pair: -like.match.start(pair[0])
    ):
        start, end = like.match.span(group)
        text = text[:start] + _written(number, like.match[group]) + text[end:]
    return f'"{text}"'


def _finding(code: str, title: str, *labels: Label) -> Finding:
    """Red where the readings are sure."""
    probability = float(np.prod([label.confidence for label in labels]))
    x, y, z = labels[0].sign.vertices.mean(axis=0).tolist()
    return Finding(
        code,
        title,
        "red" if probability > SURE else "amber",
        tuple(label.sign.id for label in labels),
        probability=probability,
        action="look, and hang the right label",
        place=(x, y, z),
    )


def _missing(labels: Sequence[Label], slots: Slots, numbering: Numbering) -> tuple[list[Finding], list[str]]:
    """Places without a label on levels where nearly all have one, and lines on levels where too few were read."""
    at = Counter(label.index for label in labels)
    findings, unread = list[Finding](), list[str]()
    for level, position in sorted({label.index[1:] for label in labels}):
        keys = [(bay, level, position) for bay, slot_level in slots if slot_level == level]
        share = sum(key in at for key in keys) / len(keys)
        if share < LEAST_READ:
            unread.append(f"missing labels on level {level}: {100 * share:.0f} % of its places have one that was read")
            continue
        for key in keys:
            if key not in at:
                slot = slots[key[:2]]
                title = f"no label was read at {slot.id} where {_named(labels[0], numbering.at(key))} belongs"
                place = tuple(slot.vertices.mean(axis=0).tolist())
                action = "look whether it is there and can be read"
                findings.append(Finding("label-missing", title, "amber", (slot.id,), action=action, place=place))
    return findings, list(dict.fromkeys(unread))


COLUMNS = ("label", "bay", "level", "position", "state", "belongs_here", "confidence", "sign")


def _table(labels: Sequence[Label], numbering: Numbering | None, states: Mapping[str, str]) -> FindingTable:
    """Which label hangs at which slot."""
    lines: list[tuple[Cell, ...]] = []
    for label in sorted(labels, key=lambda label: label.index):
        bay, level, position = label.index
        wanted = _named(label, numbering.at(label.index)).strip('"') if numbering else ""
        state = states.get(label.sign.id, "right") if numbering else ""
        lines.append((label.match[0], bay, level, position + 1, state, wanted, label.confidence, label.sign.id))
    return FindingTable("labels", "Which label hangs at which slot", COLUMNS, tuple(lines))
