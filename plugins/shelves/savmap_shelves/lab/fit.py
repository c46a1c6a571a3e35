"""The face model's parameters by maximum likelihood, from rows whose survey is known."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import groupby, pairwise
from typing import Any, Self

import numpy as np
from scipy.optimize import minimize

from savmap.types import Bools, Floats, FoundObject, Ints
from savmap.vision.evidence.intervals import Intervals, log_partitions
from savmap_shelves.face_model import POSTS_APART, FaceReader, Sections, extent, usual_width
from savmap_shelves.likelihood import FaceParameters
from savmap_shelves.report.evaluation import read_row

NEAR = 0.2
"""Of the least step from member to member: what is nearer matches."""
LINE_ROUNDS, TINY = 20, 1e-3
"""Of weighing a line's pairs anew, and the deviation below which all weigh the same, in the path's unit."""
ITERATIONS, STEP = 8, 1e-3
"""Of the ascent, and the step of its finite differences, in spreads."""
SPREADS: Mapping[str, float] = {
    "along": 0.7,
    "profile": 0.7,
    "shared": 0.7,
    "paint": 0.7,
    "chances": 1.0,
    "post": 2.0,
    "level": 2.0,
}
"""Standard deviations of parameters about the first guess: few rows do not tell all of them."""
LOGARITHMIC = ("along", "profile", "shared", "paint", "chances")
"""Those that are positive: spreads are of their logarithms."""


@dataclass(frozen=True, eq=False)
class LaidSurvey:
    """Surveyed members in the frame and the unit of a path: x (n, 2) of the posts' edges from the left, and y (m, 2) of
    the beams' edges in each bay between them."""

    posts: Floats
    sections: tuple[Floats, ...]

    @classmethod
    def by_path(cls, entry: Mapping[str, Any], path: Floats, places: Floats) -> Self:
        """A row's entry of a survey file, laid where the camera's places (n, 3) m in the row's frame are those of the
        path (n, 3). Raises OutputError where the survey is malformed."""
        row = read_row(entry)
        middle, target = places.mean(axis=0), path.mean(axis=0)
        scale = float(((places - middle) * (path - target)).sum() / np.square(places - middle).sum())
        x, y, _ = target - scale * middle
        beams = (row.beam_intervals(number) for number in range(len(row.sections)))
        return cls(scale * row.upright_intervals() + x, tuple(scale * levels + y for levels in beams))

    def moved_to(self, objects: Sequence[FoundObject]) -> Self:
        """Moved and stretched a little, to where most of the mapped objects are: the path is only roughly so long and
        so high."""
        mapped = [item for item in objects if item.is_mapped]
        posts = np.array([item.outline[:, 0].mean() for item in mapped if item.label == "upright"])
        beams = np.array([item.outline.mean(axis=0) for item in mapped if item.label == "beam"]).reshape(-1, 3)
        x = line_through(matched([(self.posts.mean(axis=1), posts)]))
        edges = x(self.posts.mean(axis=1))
        inside = [beams[(beams[:, 0] > left) & (beams[:, 0] < right), 1] for left, right in pairwise(edges)]
        y = line_through(matched([(y.mean(axis=1), heights) for y, heights in zip(self.sections, inside, strict=True)]))
        return replace(self, posts=x(self.posts), sections=tuple(y(levels) for levels in self.sections))

    def existing(self, objects: Iterable[FoundObject]) -> Iterator[tuple[float, bool]]:
        """The probability of each found object, and whether a surveyed member's middle is nearer than its width."""
        middles = self.posts.mean(axis=1)
        for item in objects:
            (left, bottom, _), (right, top, _) = item.outline.min(axis=0), item.outline.max(axis=0)
            across, low, high = middles, left, right
            if item.label == "beam":
                bay = int(np.searchsorted(middles, (left + right) / 2)) - 1
                across = self.sections[bay].mean(axis=1) if 0 <= bay < len(self.sections) else np.zeros(0)
                low, high = bottom, top
            yield item.probability, bool((np.abs(across - (low + high) / 2) < high - low).any())


def matched(lines: Sequence[tuple[Floats, Floats]]) -> Floats:
    """Pairs (k, 2) of surveyed places (n,) and the nearest of other places (m,) on the same line, as far as they are
    near once the surveyed ones are moved by what brings most of them near."""
    shifts = np.concatenate([np.subtract.outer(places, surveyed).ravel() for surveyed, places in lines])
    steps = [float(np.diff(surveyed).min()) for surveyed, _ in lines if len(surveyed) > 1]
    if not len(shifts) or not steps:
        return np.zeros((0, 2))
    room = min(steps) * NEAR

    def paired(shift: float) -> Floats:
        pairs = [
            np.column_stack([surveyed, places[np.abs(surveyed[:, None] + shift - places).argmin(axis=1)]])
            for surveyed, places in lines
            if len(surveyed) and len(places)
        ]
        moved = np.concatenate(pairs)
        return np.asarray(moved[np.abs(moved[:, 1] - moved[:, 0] - shift) < room])

    return max((paired(shift) for shift in sorted(shifts.tolist(), key=abs)), key=len)


def line_through(pairs: Floats) -> Callable[[Floats], Floats]:
    """The line through most of the pairs (k, 2) of places and those that they move to: by least absolute deviations.
    Few pairs only shift."""
    if not len(pairs):
        return lambda places: places
    middle, shift = float(np.median(pairs[:, 0])), float(np.median(pairs[:, 1] - pairs[:, 0]))
    slope = 0.0
    if len(pairs) > 2:
        along, moves = pairs[:, 0] - middle, pairs[:, 1] - pairs[:, 0]
        weights = np.ones(len(pairs))
        for _ in range(LINE_ROUNDS):
            slope, shift = np.polyfit(along, moves, 1, w=np.sqrt(weights)).tolist()
            weights = 1 / np.maximum(np.abs(moves - shift - slope * along), TINY)
    return lambda places: places + shift + slope * (places - middle)


@dataclass(frozen=True, eq=False)
class SurveyedFace:
    """What the model reads a face in, and its survey in the same frame and unit."""

    reader: FaceReader
    survey: LaidSurvey


@dataclass(frozen=True, eq=False)
class SurveyedLine:
    """A line of pooled cells: of each cell (n, k) the weights (n, k, knots) of the score table's values in its
    log-likelihood ratio, what `paint` says of it (n, k), and the surveyed members (m, 2), in cells."""

    weights: Floats
    paint: Floats
    surveyed: Floats

    @classmethod
    def of(cls, reader: FaceReader, scores: Floats, seen: Bools, paint: Floats, surveyed: Floats) -> Self:
        """From mean scores, cells that were seen and what paint says, all (n, m)."""
        knots = reader.parameters.scores
        weights = [reader.pooled(np.where(seen, np.interp(scores, knots, hat), 0.0)) for hat in np.eye(len(knots))]
        return cls(np.stack(weights, axis=-1), reader.pooled(paint), surveyed)

    def ratios(self, table: Sequence[float], paint: float) -> Floats:
        """Log-likelihood ratios (n, k) by a score table and the weight of paint."""
        return np.asarray(self.weights @ np.array(table) + paint * self.paint)


@dataclass(frozen=True, eq=False)
class Example:
    """A surveyed face as the lines that the model reads: of posts, over the patch's whole height as they are first
    read, and between their ends; and of beams in each of the `sections`. The members as they are read nearest to the
    surveyed ones: the posts' usual width in cells, and `beams`."""

    posts: tuple[SurveyedLine, SurveyedLine]
    width: float
    sections: Sections
    lines: tuple[SurveyedLine, ...]
    beams: tuple[Intervals, ...]

    @classmethod
    def of(cls, face: SurveyedFace, parameters: FaceParameters) -> Self:
        """A face as the model reads it by parameters."""
        reader = replace(face.reader, parameters=parameters)
        patch, widths = reader.uprights.patch, reader.post_widths
        posts = (face.survey.posts - patch.origin[0]) / patch.cell
        cells = intervals(np.round(posts).astype(int), widths)
        ratios = reader.ratios(reader.uprights, "upright")
        rows, means = extent(ratios, cells), reader.means(reader.uprights, "upright")
        first, last = (
            SurveyedLine.of(reader, means[part].T, ratios[part].T != 0, np.zeros(means[part].T.shape), posts)
            for part in (slice(None), slice(*rows))
        )
        width = usual_width([nearest(reader.scores(ratios[slice(*rows)].T, widths), widths, posts)])
        sections = reader.sections_between(cells, rows[1])
        levels = [(y - patch.origin[1]) / patch.cell - sections.first for y in face.survey.sections]
        scores = sections.shown(None)
        beams = [nearest(score, sections.widths, level) for score, level in zip(scores, levels, strict=True)]
        paint = sections.paint(beams)
        means = reader.means(reader.beams, "beam")[sections.first :][: len(sections.ratios)]
        lines = [
            SurveyedLine.of(
                reader, means[:, slice(*span)], sections.ratios[:, slice(*span)] != 0, said[:, slice(*span)], level
            )
            for span, said, level in zip(sections.spans, paint, levels, strict=True)
        ]
        return cls((first, last), width or float(np.diff(posts).mean()), sections, tuple(lines), tuple(beams))

    def scored(self, parameters: FaceParameters) -> Iterator["ScoredLine"]:
        """All lines with the scores that parameters give."""
        reader = replace(self.sections.reader, parameters=parameters)
        for line, usual in zip(self.posts, (None, self.width), strict=True):
            scores = reader.post_scores(line.ratios(parameters.upright, 0.0), usual)
            yield ScoredLine(scores, reader.post_widths, line.surveyed)
        sections = replace(self.sections, reader=reader)
        shown = [
            reader.block_scores(line.ratios(parameters.beam, parameters.paint), sections.widths) for line in self.lines
        ]
        of_beams = sections.scores(shown, self.beams, usual_width(self.beams))
        for score, line in zip(of_beams, self.lines, strict=True):
            yield ScoredLine(score, sections.widths, line.surveyed)


@dataclass(frozen=True, eq=False)
class ScoredLine:
    """Scores (n, w) of a line's intervals, their widths (w,), and the surveyed members (k, 2), in cells."""

    scores: Floats
    widths: Ints
    surveyed: Floats

    def surveyed_set(self) -> float:
        """The log of the sum of e^score over all sets of one interval at each surveyed member: nearer than the member's
        width. What is outside of the line is left out."""
        middles = np.arange(len(self.scores))[:, None] + self.widths / 2
        total = 0.0
        for low, high in self.surveyed.tolist():
            near = self.scores[(np.abs(middles - (low + high) / 2) < high - low) & np.isfinite(self.scores)]
            if len(near):
                total += float(np.logaddexp.reduce(near))
        return total


def intervals(cells: Ints, widths: Ints, scores: Floats | None = None) -> Intervals:
    """Intervals (k, 2) that are sure, or of these scores (k,)."""
    sure = np.full(len(cells), np.inf) if scores is None else scores
    return Intervals(cells, sure, np.zeros((0, len(widths))), widths)


def nearest(scores: Floats, widths: Ints, surveyed: Floats) -> Intervals:
    """The likeliest intervals, by scores (n, w), with middles that are nearer to surveyed members' (k, 2) than their
    widths."""
    middles = np.arange(len(scores))[:, None] + widths / 2
    cells, likely = list[tuple[int, int]](), list[float]()
    for low, high in surveyed.tolist():
        near = np.where(np.abs(middles - (low + high) / 2) < high - low, scores, -np.inf)
        first, column = np.unravel_index(int(near.argmax()), near.shape)
        if np.isfinite(near[first, column]):
            cells.append((int(first), int(first) + int(widths[column])))
            likely.append(float(near[first, column]))
    return intervals(np.array(cells, np.int64).reshape(-1, 2), widths, np.array(likely))


def log_likelihood(examples: Sequence[Example], parameters: FaceParameters) -> float:
    """Of the surveyed sets of all lines, each given what the survey says of the face's other lines."""
    lines = [line for example in examples for line in example.scored(parameters)]
    cell = examples[0].sections.reader.cells
    total = sum(line.surveyed_set() for line in lines)
    for size, group in groupby(sorted(lines, key=lambda line: len(line.widths)), lambda line: len(line.widths)):
        members = [*group]
        count = max(len(line.scores) for line in members)
        padded = [
            np.pad(line.scores, ((0, count - len(line.scores)), (0, 0)), constant_values=-np.inf) for line in members
        ]
        posts = size == len(examples[0].sections.reader.post_widths)
        gap = cell(POSTS_APART) if posts else cell(parameters.gap)
        total -= float(log_partitions(padded, members[0].widths, gap).sum())
    return total


def coordinates(parameters: FaceParameters) -> Floats:
    """The parameters that are fitted, in units of their spreads."""
    values = [np.atleast_1d(getattr(parameters, name)) for name in SPREADS]
    return np.concatenate(
        [
            (np.log(value) if name in LOGARITHMIC else value) / spread
            for (name, spread), value in zip(SPREADS.items(), values, strict=True)
        ]
    )


def at_coordinates(parameters: FaceParameters, place: Floats) -> FaceParameters:
    """The parameters with others of those that are fitted."""
    values, first = dict[str, Any](), 0
    for name, spread in SPREADS.items():
        given = getattr(parameters, name)
        part = spread * place[first : first + np.size(given)]
        part = np.exp(part) if name in LOGARITHMIC else part
        part = part / part.sum() if name == "chances" else part
        values[name] = tuple(part.tolist()) if isinstance(given, tuple) else float(part[0])
        first += len(part)
    return replace(parameters, **values)


@dataclass(frozen=True)
class Fit:
    """Fitted parameters, and the log likelihood of the surveyed sets before and after, in nats, of so many lines with
    so many members."""

    parameters: FaceParameters
    before: float
    after: float
    lines: int
    members: int


def fit(faces: Sequence[SurveyedFace], guess: FaceParameters) -> Fit:
    """The parameters of the largest posterior on surveyed faces: the likelihood of the surveyed sets, and a normal
    prior about a first guess."""
    examples, start = [Example.of(face, guess) for face in faces], coordinates(guess)

    def cost(place: Floats) -> float:
        likelihood = log_likelihood(examples, at_coordinates(guess, place))
        return 0.5 * float(np.square(place - start).sum()) - likelihood

    limits: Any = {"maxiter": ITERATIONS, "eps": STEP, "ftol": 1e-4}
    optimum = minimize(cost, start, method="L-BFGS-B", options=limits)
    parameters = at_coordinates(guess, optimum.x)
    before, after = (log_likelihood(examples, values) for values in (guess, parameters))
    members = sum(len(line.surveyed) for example in examples for line in (*example.posts[1:], *example.lines))
    return Fit(parameters, before, after, sum(2 + len(example.lines) for example in examples), members)
