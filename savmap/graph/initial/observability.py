"""Whether the references make the map's scale and place observable: checked before the solve, from the references
alone.

The pictures of a scene are the same as those of the scaled and shifted scene X -> s X + t (the structure holds the
attitudes). Every reference is one linear equation in (s, t). The covariance of s and t says what is known, the
residuals whether references agree.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from savmap.errors import SolveError
from savmap.graph.constraints import TIGHT_M, Relation, fixed_coordinate
from savmap.graph.problem import SURE_PX, Problem
from savmap.types import Axis, Floats, Ints

SCALE_LIMIT = 0.05
PLACE_LIMIT_M = 0.5
LOOSE = np.array([10.0, 1e3, 1e3, 1e3])
ASSUMED_M, ASSUMED_PART = 0.02, 0.01
ROBUST_ROUNDS = 20
SCALE, PLACE_Y = "scale", "place along y"
AXES: tuple[Axis, ...] = ("x", "y", "z")


@dataclass(frozen=True, eq=False)
class Similarity:
    """scale (1) and shift (3,) m that bring a scene to the references, with their covariance (4, 4) in that order."""

    scale: float
    shift: Floats
    covariance: Floats

    def points(self, positions: Floats) -> Floats:
        """Move positions (n, 3)."""
        return self.scale * positions + self.shift

    def sigma_at(self, position: Floats) -> Floats:
        """Standard deviation (3,) m that the references leave to a position (3,)."""
        slope = np.hstack([position[:, None], np.eye(3)])
        return np.sqrt(np.diag(slope @ self.covariance @ slope.T))


IDENTITY = Similarity(1.0, np.zeros(3), np.zeros((4, 4)))


def fit(problem: Problem, cameras: Floats, points: Floats, scene_sigma_m: float = 0.0) -> Similarity:
    """The similarity that best fits all references to a scene: camera positions (f, 3), points (m, 3), which has an
    error of `scene_sigma_m` at each reference itself."""
    rows = np.array(list(_equations(problem, cameras, points))).reshape(-1, 6)
    return _fitted(rows, np.hypot(rows[:, 5], scene_sigma_m))


def robust_fit(
    problem: Problem, cameras: Floats, points: Floats, scene_sigma_m: float
) -> tuple[Similarity, dict[str, float]]:
    """The same by the sum of absolute errors, which a minority of wrong references does not spoil; and, by name, by how
    much each reference is off then, m. With fixed poses the scene stays as it is."""
    rows = np.array(list(_equations(problem, cameras, points))).reshape(-1, 6)
    sigmas = np.hypot(rows[:, 5], scene_sigma_m)
    similarity = IDENTITY if problem.camera.fixed is not None else _fitted(rows, sigmas)
    for _ in range(ROBUST_ROUNDS if problem.camera.fixed is None else 0):
        similarity = _fitted(rows, sigmas * np.sqrt(np.maximum(_misfits(rows, similarity) / sigmas, 1.0)))
    return similarity, dict(zip(_names(problem), _misfits(rows, similarity).tolist(), strict=False))


def _misfits(rows: Floats, similarity: Similarity) -> Floats:
    """By how much equations (n, 6) are off (n,), m."""
    misfits: Floats = np.abs(rows[:, :4] @ np.append(similarity.scale, similarity.shift) - rows[:, 4])
    return misfits


def _fitted(rows: Floats, sigmas: Floats) -> Similarity:
    """By least squares, of equations (n, 6)."""
    matrix, values = rows[:, :4] / sigmas[:, None], rows[:, 4] / sigmas
    information = matrix.T @ matrix + np.diag(LOOSE**-2.0)
    covariance = np.asarray(np.linalg.inv(information), np.float64)
    solved = np.asarray(covariance @ (matrix.T @ values + LOOSE**-2.0 * np.array([1.0, 0, 0, 0])), np.float64)
    return Similarity(float(solved[0]), solved[1:], covariance)


def require_metric(problem: Problem, similarity: Similarity, centre: Floats) -> None:
    """Raise SolveError, naming what is missing, unless scale and place are known at the scene's `centre` (3,) m.

    `centre` is in the scene before the similarity. Sigmas above 5 % of scale or 0.5 m of place count as not known.
    """
    row = problem.camera.facts.name
    require_known(problem, _scale_sigma(similarity))
    for axis, sigma in zip(AXES, similarity.sigma_at(centre), strict=True):
        if sigma > PLACE_LIMIT_M:
            raise SolveError(f"row {row}: the map's place along {axis} is not known; {_place_advice(axis)}")


def _scale_sigma(similarity: Similarity) -> float:
    """Standard deviation of the scale as a part of it; infinite for a scene that would be mirrored."""
    sigma = float(np.sqrt(similarity.covariance[0, 0])) / max(abs(similarity.scale), 1e-9)
    return sigma if similarity.scale > 0 else np.inf


class UnknownScaleError(SolveError):
    """The references do not give the scale."""


def require_known(problem: Problem, scale_sigma: float) -> None:
    """Raise UnknownScaleError, naming what is missing, if the scale is not known to 5 %."""
    if not scale_sigma < SCALE_LIMIT:
        raise UnknownScaleError(
            f"row {problem.camera.facts.name}: the map's scale is not known; {_scale_advice(problem)}"
        )


def assume_missing(problem: Problem, cameras: Floats, points: Floats) -> Problem:
    """The problem with what its references leave open of scale and place taken from a scene: camera positions (f, 3)
    and points (m, 3) as the start has them; of a whole map a plugin's unit of length, and y = 0 at the lowest point
    that was measured often: there the scene must be. It is itself where nothing is open."""
    similarity = fit(problem, cameras, points)
    if not _scale_sigma(similarity) < SCALE_LIMIT:
        unit = () if problem.partial else next((part.unit for part in problem.parts if part.unit), ())
        scale = unit or extent(problem, cameras, points, ASSUMED_PART, "assumed scale")
        problem = _with_assumed(problem, scale, SCALE)
        similarity = fit(problem, cameras, points)
    for axis, column, sigma in zip(AXES, range(3), similarity.sigma_at(points.mean(axis=0)), strict=True):
        if sigma > PLACE_LIMIT_M:
            held = Relation(axis, int(problem.keys[0]), None, float(points[0, column]), ASSUMED_M, f"assumed {axis}")
            if axis == "y" and not problem.partial:
                held = fixed_coordinate(axis, int(problem.keys[lowest(problem, points)]))
            problem = _with_assumed(problem, (held,), f"place along {axis}")
    return problem


def assumptions(problem: Problem) -> tuple[str, ...]:
    """What to tell the user of what was assumed for want of references."""
    return tuple(
        "nothing gives the scale: the map is in units of its own, not in metres; give a length"
        if what == SCALE
        else f"nothing gives the {what}: it is 0 at the lowest edge that was measured"
        for what in problem.assumed
    )


def lowest(problem: Problem, points: Floats) -> int:
    """Which of the points (m, 3) that were measured often, their heights too, is the lowest."""
    tall = problem.measurements.covariances[:, 1, 1] > SURE_PX**2
    count = len(points)
    measured = np.bincount(problem.at_key, minlength=count) > 2 * np.bincount(problem.at_key[tall], minlength=count)
    often = _often(problem, count)
    often = often[measured[often]] if measured[often].any() else often
    return int(often[points[often, 1].argmin()])


def _often(problem: Problem, count: int) -> Ints:
    """Which of the points were measured often."""
    counts = np.bincount(problem.at_key, minlength=count)
    return np.flatnonzero(counts >= np.median(counts))


def _with_assumed(problem: Problem, relations: tuple[Relation, ...], what: str) -> Problem:
    return replace(problem, relations=(*problem.relations, *relations), assumed=(*problem.assumed, what))


def extent(problem: Problem, cameras: Floats, points: Floats, part: float, name: str = "") -> tuple[Relation, ...]:
    """The extent of a scene, points (m, 3), along the way of the cameras (f, 3), known to a `part` of it: between the
    farthest of what was measured often. Across the way lie the ends of lines, which may be anywhere along them. Nothing
    of a scene without extent."""
    often = _often(problem, len(points))
    column = int(np.argmax(np.ptp(cameras, axis=0)))
    first, last = (int(often[end(points[often, column])]) for end in (np.argmin, np.argmax))
    value = float(points[last, column] - points[first, column])
    keys = problem.keys.tolist()
    return (Relation(AXES[column], keys[first], keys[last], value, part * value, name),) if value else ()


def _equations(problem: Problem, cameras: Floats, points: Floats) -> Iterator[Floats]:
    """Rows (6,): factors of s, t_x, t_y, t_z, then value and sigma. Fixed coordinates stay as they are."""
    for height in problem.camera.references.camera_heights:
        seen = [chunk for chunk in problem.passes(height.passes) if len(chunk)]
        if seen:
            level = float(np.median(cameras[np.concatenate(seen), 1]))
            yield np.array([level, 0, 1, 0, height.value_m, height.sigma_m])
    yield from (equation(problem, relation, points) for relation in problem.relations if relation.name)
    for axis in sorted({r.column for r in problem.relations if r.b is None and not r.name}):
        yield np.concatenate([np.zeros(1), np.eye(3)[axis], [0.0, TIGHT_M]])


def _names(problem: Problem) -> Iterator[str]:
    """The references of the first `_equations`."""
    for height in problem.camera.references.camera_heights:
        if any(len(chunk) for chunk in problem.passes(height.passes)):
            yield height.name
    yield from (relation.name for relation in problem.relations if relation.name)


def equation(problem: Problem, relation: Relation, points: Floats) -> Floats:
    """A relation as a row (6,): factors of s, t_x, t_y, t_z, then value and sigma."""
    first = points[problem.index(relation.a)]
    span = first if relation.b is None else points[problem.index(relation.b)] - first
    row = np.zeros(6)
    row[4:] = relation.value, relation.sigma
    if relation.axis is None:
        row[0] = np.linalg.norm(span)
        return row
    row[0] = span[relation.column]
    row[1 + relation.column] = relation.b is None
    return row


def _scale_advice(problem: Problem) -> str:
    if problem.camera.references.markers:
        names = " and ".join(marker.name for marker in problem.camera.references.markers)
        remedy = "see that it is in the footage, or give another reference"
        return f"marker {names} was not seen well enough to give it: {remedy}"
    heights = bool(problem.camera.references.camera_heights)
    on_structure = [r for r in problem.relations if r.name and r.axis == "y" and r.b is None]
    levels = any(not relation.presumed for relation in on_structure)
    if heights and not levels:
        why = "".join(
            f", and the {name} is not seen well" for name in sorted({relation.name for relation in on_structure})
        )
        return f"a camera height alone does not give it{why}: add {_height_reference(problem)} or a known length"
    if levels and not heights:
        remedy = "add a camera height or a known length under 'references'"
        return f"known heights on the structure alone do not give it: {remedy}"
    return (
        "add a known length or a marker, or a camera height and a known height on the structure, "
        "or two surveyed points under 'references'"
    )


def _height_reference(problem: Problem) -> str:
    """A known height on the structure, with how the plugins' users give it."""
    given = " or ".join(part.height_reference for part in problem.parts if part.height_reference)
    return f"a known height on the structure ({given})" if given else "a known height on the structure"


def _place_advice(axis: str) -> str:
    if axis == "y":
        return "give a camera height, a known height on the structure or a surveyed point under 'references'"
    return "give a surveyed point under 'references'"
