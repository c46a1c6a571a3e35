"""Fit the face model's parameters to rows whose racks are known, by maximum likelihood.

    python -m savmap_shelves.lab.fit SITE.yaml [SITE.yaml ...] --write

Each site is mapped, and its survey (survey.json beside it) is laid on the evidence by the map. The score tables come from the cells of the
surveyed members and of what lies between them, with the cells that goods hide told by expectation-maximisation. The other parameters maximise
the log posterior of the surveyed members, one after the other, in a few rounds.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np

from savmap.types import Bools, Floats, FoundObject, Ints, PlaneEvidence, Structure
from savmap.vision.evidence.intervals import Intervals, log_evidence
from savmap_shelves.face_model import HIGHEST, NARROWEST, FaceReader
from savmap_shelves.likelihood import FaceParameters

EDGES = (0.0, 0.01, 0.02, 0.04, 0.08, 0.15, 0.25, 0.4, 0.6, 0.8, 0.92, 0.98, 1.0)
"""Borders of the score tables' bins."""
HIDDEN, EXPECTATIONS, LEAST, MOST = 0.15, 8, 20.0, 4.0
"""The first share of hidden cells, rounds of expectation-maximisation, what is added to each bin's count, and the greatest log ratio."""
STEPS: Mapping[str, tuple[float, ...]] = {
    "along": (0.6, 1.6),
    "level": (0.8, 1.25),
    "shared": (0.7, 1.4),
    "profile": (0.7, 1.4),
    "paint": (0.5, 2.0),
}
"""By what factors each parameter is tried in turn."""
ROUNDS = 3


@dataclass(frozen=True, eq=False)
class SurveyedFace:
    """Evidence of a face, its camera (height above the patch's lower side, distance), and the surveyed members in cells: posts along x, and
    beams of each section along y."""

    uprights: PlaneEvidence
    beams: PlaneEvidence
    camera: tuple[float, float]
    posts: Floats
    sections: Sequence[Floats]

    def reader(self, parameters: FaceParameters) -> FaceReader:
        """A reader of the face."""
        return FaceReader(self.uprights, self.beams, self.camera, None, parameters)

    @property
    def spans(self) -> list[tuple[int, int]]:
        """First and last + 1 column between the posts of each section."""
        return [(int(np.ceil(left[1])) + 1, int(right[0]) - 1) for left, right in pairwise(self.posts)]

    def mask(self, evidence: PlaneEvidence, label: str) -> tuple[Bools, Bools]:
        """The cells (rows, columns), the lowest row first, of a class's members, and those of none, a cell away from both."""
        shape = evidence.weight.shape
        inside, near = np.zeros((2, *shape), np.bool_)
        top = max(float(levels.max()) for levels in self.sections if len(levels))
        if label == "upright":
            for low, high in self.posts:
                inside[: int(top), int(np.ceil(low)) : int(high)] = True
                near[:, int(low) - 1 : int(high) + 2] = True
        else:
            for span, levels in zip(self.spans, self.sections, strict=True):
                for low, high in levels:
                    inside[int(np.ceil(low)) : int(high), slice(*span)] = True
                    near[max(int(low) - 1, 0) : int(high) + 2, slice(*span)] = True
        between = np.zeros(shape, np.bool_)
        between[: int(top), int(self.posts[0, 0]) : int(self.posts[-1, 1])] = True
        seen = evidence.weight[::-1] > 0
        return inside & seen, between & seen & ~near


def surveyed_face(
    evidence: tuple[PlaneEvidence, PlaneEvidence],
    camera: tuple[float, float],
    objects: Sequence[FoundObject],
    structures: Sequence[Structure],
    survey: Mapping[str, Any],
) -> SurveyedFace:
    """The surveyed members laid on evidence as the mapped structures lie on the found objects."""
    places = {structure.id: structure.vertices.mean(axis=0) for structure in structures}
    both = [thing for thing in objects if thing.id in places and thing.label == "beam"]
    mapped, found = np.array([places[thing.id] for thing in both]), np.array([t.outline.mean(axis=0) for t in both])
    patch = evidence[0].patch
    scale = float(np.std(found[:, :2] - found[:, :2].mean(axis=0)) / np.std(mapped[:, :2] - mapped[:, :2].mean(axis=0)))

    def cells(values: Sequence[Sequence[float]], axis: int) -> Floats:
        moved = (np.array(values).reshape(-1, 2) - mapped[:, axis].mean()) * scale + found[:, axis].mean()
        return np.asarray((moved - patch.origin[axis]) / patch.cell)

    sections = [cells(section["beams"], 1) for section in survey["sections"]]
    return SurveyedFace(*evidence, camera, cells(survey["uprights"], 0), sections)


def score_table(faces: Sequence[SurveyedFace], label: str) -> tuple[list[float], list[float]]:
    """Scores, and the log ratios of visible members' cells to those of none at them."""
    members, others = np.zeros((2, len(EDGES) - 1))
    for face in faces:
        evidence = face.uprights if label == "upright" else face.beams
        inside, none = face.mask(evidence, label)
        mean = evidence.of(label)[::-1]
        members += np.histogram(mean[inside], EDGES)[0]
        others += np.histogram(mean[none], EDGES)[0]
    p_member, p_none = ((counts + LEAST) / (counts + LEAST).sum() for counts in (members, others))
    visible, hidden = p_member.copy(), HIDDEN
    for _ in range(EXPECTATIONS):
        shown = (1 - hidden) * visible / ((1 - hidden) * visible + hidden * p_none)
        hidden = 1 - float((p_member * shown).sum())
        visible = np.maximum(p_member * shown, 1e-6)
        visible /= visible.sum()
    ratios = np.maximum.accumulate(np.clip(np.log(visible / p_none), -MOST, MOST))
    middles = [(low + high) / 2 for low, high in pairwise(EDGES)]
    return middles, [round(float(ratio), 3) for ratio in ratios]


def log_posterior(face: SurveyedFace, parameters: FaceParameters) -> float:
    """Of the surveyed beams of all sections, each given the others'."""
    reader = face.reader(parameters)
    widths = np.arange(NARROWEST, reader.cells(HIGHEST))
    ratios = reader.ratios(face.beams, "beam")
    truth = [_intervals(levels, widths, len(ratios)) for levels in face.sections]
    usual = float(np.median(np.concatenate([np.diff(part.cells, axis=1)[:, 0] for part in truth])))
    middles = np.arange(len(ratios))[:, None] + widths / 2
    total = 0.0
    for number, (span, own) in enumerate(zip(face.spans, truth, strict=True)):
        scores = reader._scores(ratios[:, slice(*span)], widths) + reader._profile(widths, usual)
        scores = scores + reader._levels(number, truth, middles)
        total -= log_evidence(scores, widths, reader.cells(parameters.gap))
        total += sum(_nearby(scores, low, high - low - NARROWEST) for low, high in own.cells.tolist())
    return total


def _nearby(scores: Floats, first: int, column: int) -> float:
    """The best score of an interval within a cell of a surveyed one: the survey's laying is not better."""
    rows = slice(max(first - 1, 0), first + 2)
    columns = slice(max(column - 1, 0), column + 2)
    return float(scores[rows, columns].max(initial=-np.inf))


def _intervals(levels: Floats, widths: Ints, count: int) -> Intervals:
    cells = np.round(levels).astype(np.int64).reshape(-1, 2)
    cells = cells[(cells[:, 0] >= 0) & (cells[:, 1] < count)]
    cells[:, 1] = np.clip(cells[:, 1], cells[:, 0] + widths[0], cells[:, 0] + widths[-1])
    return Intervals(cells, np.full(len(cells), np.inf), np.zeros((count, len(widths))), widths)


def fit(faces: Sequence[SurveyedFace], start: FaceParameters) -> FaceParameters:
    """The parameters that make the surveyed members most likely."""
    scores, upright = score_table(faces, "upright")
    _, beam = score_table(faces, "beam")
    best = replace(start, scores=tuple(scores), upright=tuple(upright), beam=tuple(beam))
    most = sum(log_posterior(face, best) for face in faces)
    for _ in range(ROUNDS):
        for trial in _trials(best):
            value = sum(log_posterior(face, trial) for face in faces)
            if value > most:
                best, most = trial, value
    return best


def _trials(parameters: FaceParameters) -> Iterator[FaceParameters]:
    for name, factors in STEPS.items():
        for factor in factors:
            yield replace(parameters, **{name: round(factor * getattr(parameters, name), 4)})


def reliability(faces: Sequence[SurveyedFace], parameters: FaceParameters) -> Floats:
    """(4, 2): how many members the model gives each range of P (to 0.1, 0.5, 0.9, 1), and how many of these are surveyed."""
    table = np.zeros((4, 2))
    for face in faces:
        read = face.reader(parameters).read()
        if read is None or len(read.posts) != len(face.posts):
            continue
        cell = face.uprights.patch.cell
        for members, possible, levels in zip(read.sections, read.possible, face.sections, strict=True):
            for member in (*members, *possible):
                middle, half = (member.low + member.high) / 2 / cell, (member.high - member.low) / 2 / cell
                real = bool((np.abs(levels.mean(axis=1) - middle) < max(half, 2.0)).any()) if len(levels) else False
                table[np.searchsorted((0.1, 0.5, 0.9), member.probability)] += (1, real)
    return table
