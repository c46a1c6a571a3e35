"""The face model's parameters by maximum likelihood, from rows whose survey is known."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from typing import Any, Self

import numpy as np
from scipy.optimize import minimize

from savmap.types import Floats, FoundObject, Ints
from savmap.vision.evidence.intervals import Intervals, log_partitions
from savmap_shelves.face_model import POOLED, POSTS_APART, FaceReader, Sections, extent, rear_ratio, usual_width
from savmap_shelves.likelihood import FaceParameters
from savmap_shelves.report.evaluation import read_row

LINE_ROUNDS, TINY = 20, 1e-3
"""Of weighing a line's pairs anew, and the deviation below which all weigh the same, in the path's unit."""
STEPS = 200
"""Evaluations of the posterior in each ascent."""
SPREADS: Mapping[str, float] = {
    "along": 0.7,
    "profile": 0.7,
    "shared": 0.7,
    "paint": 0.7,
    "post": 2.0,
    "level": 2.0,
    "rear": 3.0,
}
"""Standard deviations of parameters about the first guess: of the logarithm of the first four, and of log rates."""
SHARES = (0.5, 1.0)
"""Of the way to the counted tables."""
LOGARITHMIC = ("along", "profile", "shared", "paint")
SPREAD_NATS, MEMBERS = 1.0, 10.0
"""Standard deviation of the tables' values about the first guess, and how many members the first guess of the hidden
shares is worth."""


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
        """Moved and stretched a little, to where most of the mapped objects are: the path is known to some cells."""
        mapped = [item for item in objects if item.is_mapped]
        posts = np.array([item.outline[:, 0].mean() for item in mapped if item.label == "upright"])
        beams = np.array([item.outline.mean(axis=0) for item in mapped if item.label == "beam"]).reshape(-1, 3)
        x = line_through(matched(self.posts.mean(axis=1), posts))
        edges, pairs = x(self.posts.mean(axis=1)), list[Floats]()
        for left, right, levels in zip(edges, edges[1:], self.sections, strict=False):
            inside = beams[(beams[:, 0] > left) & (beams[:, 0] < right), 1]
            pairs.append(matched(levels.mean(axis=1), inside))
        y = line_through(np.concatenate(pairs))
        return replace(self, posts=x(self.posts), sections=tuple(y(levels) for levels in self.sections))

    def existing(self, objects: Iterable[FoundObject]) -> Iterator[tuple[float, bool]]:
        """The probability of each found object, and whether a surveyed member's middle is within its borders."""
        middles = self.posts.mean(axis=1)
        for item in objects:
            (left, bottom, _), (right, top, _) = item.outline.min(axis=0), item.outline.max(axis=0)
            if item.label == "upright":
                yield item.probability, bool(((middles > left) & (middles < right)).any())
            else:
                bay = int(np.searchsorted(middles, (left + right) / 2)) - 1
                levels = self.sections[bay].mean(axis=1) if 0 <= bay < len(self.sections) else np.zeros(0)
                yield item.probability, bool(((levels > bottom) & (levels < top)).any())


def matched(surveyed: Floats, places: Floats) -> Floats:
    """Pairs (k, 2) of a surveyed place (n,) and the nearest of other places (m,), if it is nearer than half a step."""
    if not len(surveyed) or not len(places):
        return np.zeros((0, 2))
    nearby = places[np.abs(surveyed[:, None] - places).argmin(axis=1)]
    room = np.diff(surveyed).min() / 2 if len(surveyed) > 1 else np.inf
    return np.asarray(np.column_stack([surveyed, nearby])[np.abs(nearby - surveyed) < room])


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
class Example:
    """A surveyed face as the lines that the model reads.

    Of posts: the `rows` between which they show, log-likelihood `ratios` (rows, columns), the `posts` as read nearest
    to the surveyed ones, and these (k, 2), in cells. Of beams: the same in each of the `sections`, what `paint` says of
    their cells, and the rear members' ratio.
    """

    rows: tuple[int, int]
    ratios: Floats
    posts: Intervals
    surveyed_posts: Floats
    sections: Sections
    beams: tuple[Intervals, ...]
    surveyed_beams: tuple[Floats, ...]
    paint: tuple[Floats, ...]
    rear: float

    @classmethod
    def of(cls, face: SurveyedFace, parameters: FaceParameters) -> Self:
        """A face as the model reads it by parameters."""
        reader = replace(face.reader, parameters=parameters)
        patch = reader.uprights.patch
        cells, widths = (face.survey.posts - patch.origin[0]) / patch.cell, reader.post_widths
        ratios = reader.ratios(reader.uprights, "upright")
        rows = extent(ratios, intervals(np.round(cells).astype(int), widths))
        ratios = ratios[slice(*rows)]
        posts = nearest(reader.post_scores(ratios, None), widths, cells)
        sections = reader.sections_between(intervals(np.round(cells).astype(int), widths), rows[1])
        levels = tuple((y - patch.origin[1]) / patch.cell - sections.first for y in face.survey.sections)
        scores, paint, rear = sections.shown(None), list[Floats](), 0.0
        beams = [nearest(score, sections.widths, level) for score, level in zip(scores, levels, strict=True)]
        usual = usual_width(beams)
        if usual is not None:
            paint = sections.paint(beams)
            rear = rear_ratio(sections.shown(paint), beams, sections.widths, sections.camera, usual)
        return cls(rows, ratios, posts, cells, sections, tuple(beams), levels, tuple(paint), rear)

    def cells(self, label: str) -> Iterator[tuple[Floats, Floats, Intervals]]:
        """Of each line of a class: mean scores and log-likelihood ratios (n, m) of its cells, and its members."""
        reader = self.sections.reader
        if label == "upright":
            scores = reader.means(reader.uprights, label)
            yield scores[slice(*self.rows)].T, self.ratios.T, self.posts
            return
        scores = reader.means(reader.beams, label)[self.sections.first :][: len(self.sections.ratios)]
        for span, line in zip(self.sections.spans, self.beams, strict=True):
            yield scores[:, slice(*span)], self.sections.ratios[:, slice(*span)], line

    def scored(self, parameters: FaceParameters) -> Iterator["ScoredLine"]:
        """All lines with the scores that parameters give; the table of scores stays as it was."""
        reader = replace(self.sections.reader, parameters=parameters)
        usual = float(np.median(np.diff(self.posts.cells, axis=1)))
        yield ScoredLine(reader.post_scores(self.ratios, usual), reader.post_widths, self.surveyed_posts)
        sections = replace(self.sections, reader=reader)
        scores = sections.scores(sections.shown(self.paint), self.beams, usual_width(self.beams), self.rear)
        for score, surveyed in zip(scores, self.surveyed_beams, strict=True):
            yield ScoredLine(score, sections.widths, surveyed)


@dataclass(frozen=True, eq=False)
class ScoredLine:
    """Scores (n, w) of a line's intervals, their widths (w,), and the surveyed members (k, 2), in cells."""

    scores: Floats
    widths: Ints
    surveyed: Floats

    def surveyed_set(self) -> float:
        """The log of the sum of e^score over all sets of one interval at each surveyed member: with its middle within
        the member's borders. What is outside of the line is left out."""
        middles = np.arange(len(self.scores))[:, None] + self.widths / 2
        total = 0.0
        for low, high in self.surveyed.tolist():
            near = self.scores[(middles >= low) & (middles <= high) & np.isfinite(self.scores)]
            if len(near):
                total += float(np.logaddexp.reduce(near))
        return total


def intervals(cells: Ints, widths: Ints, scores: Floats | None = None) -> Intervals:
    """Intervals (k, 2) that are sure, or of these scores (k,)."""
    sure = np.full(len(cells), np.inf) if scores is None else scores
    return Intervals(cells, sure, np.zeros((0, len(widths))), widths)


def nearest(scores: Floats, widths: Ints, surveyed: Floats) -> Intervals:
    """The likeliest intervals, by scores (n, w), with their middles within the borders of surveyed members (k, 2)."""
    middles = np.arange(len(scores))[:, None] + widths / 2
    cells, likely = list[tuple[int, int]](), list[float]()
    for low, high in surveyed.tolist():
        near = np.where((middles >= low) & (middles <= high), scores, -np.inf)
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


def log_prior(parameters: FaceParameters, guess: FaceParameters) -> float:
    """Of parameters, about the first guess: few rows do not tell all of them."""
    steps = coordinates(parameters) - coordinates(guess)
    tables = np.subtract([parameters.upright, parameters.beam], [guess.upright, guess.beam])
    return float(-0.5 * np.square(steps).sum() - 0.5 * np.square(tables / SPREAD_NATS).sum())


def coordinates(parameters: FaceParameters) -> Floats:
    """The single parameters that are fitted, in units of their spreads."""
    values = ((name, getattr(parameters, name), spread) for name, spread in SPREADS.items())
    return np.array([(np.log(value) if name in LOGARITHMIC else value) / spread for name, value, spread in values])


def at_coordinates(parameters: FaceParameters, place: Floats) -> FaceParameters:
    """The parameters with those single ones."""
    values: dict[str, Any] = {
        name: float(value * spread) for (name, spread), value in zip(SPREADS.items(), place, strict=True)
    }
    return replace(
        parameters, **{name: float(np.exp(value)) if name in LOGARITHMIC else value for name, value in values.items()}
    )


@dataclass(frozen=True)
class Fit:
    """Fitted parameters, and the log posterior of the surveyed sets before and after, in nats, of so many lines with so
    many members."""

    parameters: FaceParameters
    before: float
    after: float
    lines: int
    members: int


def fit(faces: Sequence[SurveyedFace], guess: FaceParameters, tell: Callable[[str], None] = print) -> Fit:
    """The parameters of the largest posterior on surveyed faces: tables and chances by counting (expectation
    maximisation), or the first guess where the surveyed sets are not likelier by them; the others by the simplex method
    (Nelder and Mead, 1965). `tell` is given a line for each step."""
    examples = [Example.of(face, guess) for face in faces]
    lines = [line for example in examples for line in example.scored(guess)]
    before = log_posterior(examples, guess, guess)
    parameters, best = climbed(examples, guess, guess)
    tell(f"{before:.1f} nats; {best:.1f} with rates, spreads and weights fitted")
    counted = counted_tables(examples, parameters, guess)
    for share in SHARES:
        proposed = blended(parameters, counted, share)
        proposed, value = climbed([Example.of(face, proposed) for face in faces], proposed, guess)
        tell(f"{value:.1f} nats with {100 * share:.0f} % of the way to counted tables and chances")
        if value > best:
            parameters, best = proposed, value
    return Fit(parameters, before, best, len(lines), sum(len(line.surveyed) for line in lines))


def log_posterior(examples: Sequence[Example], parameters: FaceParameters, guess: FaceParameters) -> float:
    """Of the surveyed sets and the parameters, up to a constant."""
    return log_likelihood(examples, parameters) + log_prior(parameters, guess)


def climbed(
    examples: Sequence[Example], parameters: FaceParameters, guess: FaceParameters
) -> tuple[FaceParameters, float]:
    """The parameters with the single ones at a maximum of the posterior, and its value."""
    start = coordinates(parameters)
    options: Any = {"maxfev": STEPS, "xatol": 0.02, "fatol": 0.1, "initial_simplex": simplex(start)}
    optimum = minimize(
        lambda place: -log_posterior(examples, at_coordinates(parameters, place), guess),
        start,
        method="Nelder-Mead",
        options=options,
    )
    return at_coordinates(parameters, optimum.x), -float(optimum.fun)


def simplex(place: Floats) -> Floats:
    """A place and a step from it along each coordinate."""
    return np.asarray(np.vstack([place, place + 0.5 * np.eye(len(place))]))


def blended(parameters: FaceParameters, other: FaceParameters, share: float) -> FaceParameters:
    """Tables and chances so far from those of parameters to the other's."""
    values: dict[str, Any] = {
        name: tuple(
            ((1 - share) * np.array(getattr(parameters, name)) + share * np.array(getattr(other, name))).tolist()
        )
        for name in ("upright", "beam", "chances")
    }
    return replace(parameters, **values)


def counted_tables(examples: Sequence[Example], parameters: FaceParameters, guess: FaceParameters) -> FaceParameters:
    """The tables and the hidden shares' chances by counting: cells of surveyed members, each as far as it is not
    hidden, against all other cells. Of cells that say the same, one counts."""
    tables: dict[str, Any] = {}
    hidden, knots = MEMBERS * np.array(guess.chances), np.array(parameters.scores)
    for label in ("upright", "beam"):
        members, others = np.zeros((2, len(knots)))
        for example in examples:
            reader = replace(example.sections.reader, parameters=parameters)
            for scores, ratios, line in example.cells(label):
                visible, likely = visibility(reader, ratios, line)
                hidden += likely
                inside = np.zeros(len(scores), np.bool_)
                for low, high in line.cells.tolist():
                    inside[low:high] = True
                members += counts(scores, visible, knots)
                others += counts(scores, (~inside[:, None] & (ratios != 0)).astype(np.float64), knots)
        occlusion = examples[0].sections.reader.parameters.occlusion(examples[0].sections.reader.cell)
        alike = occlusion.same_along * occlusion.same_across
        precision = 1 / (1 / (members / alike + 0.5) + 1 / (others / alike + 0.5))
        shares = ((values + alike / 2) / (values + alike / 2).sum() for values in (members, others))
        counted = np.subtract(*(np.log(share) for share in shares))
        first = np.array(getattr(guess, label)) / SPREAD_NATS**2
        fitted = (precision * counted + first) / (precision + 1 / SPREAD_NATS**2)
        tables[label] = tuple(fitted.round(3).tolist())
    return replace(parameters, **tables, chances=tuple((hidden / hidden.sum()).tolist()))


def visibility(reader: FaceReader, ratios: Floats, line: Intervals) -> tuple[Floats, Floats]:
    """How likely each cell (n, m) is of a line's interval and not hidden, and how many of the intervals hide each share
    (h,), by the cells' log-likelihood ratios."""
    visible, occlusion = np.zeros(ratios.shape), reader.occlusion
    hidden, shares = np.zeros(len(occlusion.shares)), np.array(occlusion.shares)[:, None, None]
    blocks = np.exp(reader.pooled(ratios))
    together, wide = occlusion.same_along * occlusion.same_across, reader.cells(POOLED)
    for low, high in line.cells.tolist():
        mixed = shares + (1 - shares) * blocks[low:high]
        scores = np.log(mixed).sum(axis=(1, 2)) / together + np.log(occlusion.chances)
        likely = np.exp(scores - np.logaddexp.reduce(scores))
        hidden += likely
        shown = (likely[:, None, None] * (1 - shares) * blocks[low:high] / mixed).sum(axis=0)
        visible[low:high, : shown.shape[1] * wide] = np.repeat(shown, wide, axis=1)
    return visible * (ratios != 0), hidden


def counts(scores: Floats, weights: Floats, knots: Floats) -> Floats:
    """How many cells, each with a weight, have the scores of knots (k,); those between two count for both in parts."""
    places = np.interp(scores, knots, np.arange(len(knots)))
    lower = np.minimum(places.astype(int), len(knots) - 2)
    parts = places - lower
    total = np.zeros(len(knots))
    np.add.at(total, lower, weights * (1 - parts))
    np.add.at(total, lower + 1, weights * parts)
    return total
