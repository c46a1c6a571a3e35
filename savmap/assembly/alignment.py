"""Where the site stands in the user's world (`align:` of a site file), by places known in both; what contradicts is
named."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import chdtrc

from savmap.assembly.known_places import KnownPlace, known_places
from savmap.assembly.rigid_fit import PlaceEquations, RigidFit
from savmap.errors import SiteError
from savmap.site.load import KnownAlignment
from savmap.types import Alignment, AlignmentResidual, Floats, Measured, SiteMap
from savmap.types.written import FARTHEST_WORLD_M

CONTRADICTS = 0.001
"""Places whose residuals are as unlikely as this contradict one another."""
MOST_HEADING_DEG, MOST_SHIFT_M = 5.0, 3.0
"""Standard deviations of a site of which it is not known how it is turned, or where it stands."""
MOST_SHARE = 3
"""One in so many places may be left out."""
SUSPECTS = 20
OFF_SIGMA = 3.0


@dataclass(frozen=True)
class Aligned:
    """The site map with its alignment, and what the user should know."""

    site_map: SiteMap
    notes: tuple[str, ...] = ()


def aligned(site_map: SiteMap, source: KnownAlignment) -> Aligned:
    """The site map where the user says that it stands. Raises SiteError with the place in the file for places that are
    not in the map, that do not tell where the site stands, or that contradict one another so that it cannot be told
    which is wrong."""
    section = source.section
    anchor = (section.anchor.latitude_deg, section.anchor.longitude_deg) if section.anchor else None
    if section.x_m is not None and section.y_m is not None and section.heading_deg is not None:
        covariance = np.diag(np.square([section.sigma_m, section.sigma_m, section.sigma_deg]))
        heading = 180 - (180 - section.heading_deg) % 360
        alignment = Alignment(section.x_m, section.y_m, heading, covariance, section.z_m)
        return Aligned(replace(site_map, alignment=replace(alignment, anchor=anchor)))
    mapped = known_places(site_map, source)
    placements = {name: placement.covariance for name, placement in site_map.placements.items()}
    equations = PlaceEquations(mapped.places, placements, mapped.directed)
    choice = _chosen(equations, source)
    height, height_notes = _height(mapped.places, section.z_m, source)
    alignment = _alignment(equations, choice, height)
    return Aligned(
        replace(site_map, alignment=replace(alignment, anchor=anchor)), (*mapped.left_out, *choice.notes, *height_notes)
    )


def alignment_lines(site_map: SiteMap) -> Iterator[str]:
    """Lines of where the site stands in the user's world, and of what is left at each place. None where it is not
    aligned."""
    alignment = site_map.alignment
    if alignment is None:
        return
    x, y, turn = np.sqrt(np.diag(alignment.covariance))
    place = f"x {alignment.x_m:.3f}, y {alignment.y_m:.3f}, z {alignment.z_m:.3f} m"
    pose = f"{place}, heading {alignment.heading_deg:.3f} degrees"
    yield f"the site in your world: {pose} (sigma {100 * x:.1f}, {100 * y:.1f} cm, {turn:.3f} degrees)"
    if alignment.residuals:
        wide = max(len(f"row {residual.row}, {residual.at}") for residual in alignment.residuals)
        yield f"{'place':>{wide}}{'x':>9}{'y':>9}{'z':>9}{'in sigmas':>11}   given less mapped, cm"
        for residual in alignment.residuals:
            cells = "".join(
                f"{'-':>9}" if np.isnan(v) else f"{round(100 * v, 2) + 0.0:9.2f}" for v in residual.residual_m
            )
            out = "" if residual.used else "   left out"
            yield f"{f'row {residual.row}, {residual.at}':>{wide}}{cells}{residual.deviation:11.1f}{out}"
    if alignment.scale is not None:
        percent, sigma = 100 * (alignment.scale.value - 1), 100 * alignment.scale.sigma
        figure = f"{percent:+.2f} % (sigma {sigma:.2f} %)"
        yield f"distances between these places: {figure} against the map, whose scale stays"


@dataclass(frozen=True, eq=False)
class _Choice:
    """A fit with the equations that it rests on, the numbers of places left out, the scale, and what the user should
    know."""

    used: PlaceEquations
    fit: RigidFit
    left_out: Sequence[int]
    scale: Measured | None
    notes: Sequence[str]
    inflation: float = 1.0


def _chosen(equations: PlaceEquations, source: KnownAlignment) -> _Choice:
    """The fit of all places, or of those that agree. Raises SiteError as `aligned` does."""
    fit = _determined(equations, source)
    scale = equations.scale(fit)
    if fit.likelihood >= CONTRADICTS:
        return _Choice(equations, fit, (), scale, _scale_notes(scale, source))
    scaled = equations.likelihood_with(fit, scale) if scale is not None else 0.0
    choice = _without_wrong_ones(equations, source)
    if choice is not None and choice.fit.likelihood >= scaled:
        return choice
    if scaled >= CONTRADICTS:
        inflation = fit.squares / (len(fit.residuals) - 3)
        return _Choice(equations, fit, (), scale, _scale_notes(scale, source), inflation)
    raise SiteError(source.line((), _contradiction(equations, fit)))


def _determined(equations: PlaceEquations, source: KnownAlignment) -> RigidFit:
    """The likeliest fit. Raises SiteError where there are several, or where it leaves the heading or the place open."""
    if not equations.places:
        raise SiteError(source.line((), "none of its rows were mapped"))
    fits = [fit for fit in equations.fits() if np.abs(fit.shift).max() < FARTHEST_WORLD_M]
    if not fits:
        what = "no way to turn and move the site brings its places where they are known"
        raise SiteError(source.line((), f"{what}, in the order in which lines name them"))
    heading, shift = equations.spread(fits[0])
    if np.degrees(heading) > MOST_HEADING_DEG:
        sure = f"+- {np.degrees(heading):.0f} degrees" if np.degrees(heading) < 180 else "at all"
        raise SiteError(
            source.line((), f"the places do not say how the site is turned ({sure}): give others, further apart")
        )
    if shift > MOST_SHIFT_M:
        raise SiteError(
            source.line((), "the places do not say where the site stands: lines leave it open along them, add a point")
        )
    if len(fits) > 1:
        turns = " or ".join(f"{np.degrees(fit.heading_rad):.0f}" for fit in fits)
        raise SiteError(source.line((), f"the places fit with heading {turns} degrees: give another point"))
    return fits[0]


def _without_wrong_ones(equations: PlaceEquations, source: KnownAlignment) -> _Choice | None:
    """The fit without as few places as it takes for the others to agree; None where that cannot be told."""
    left: list[int] = []
    numbers = list(range(len(equations.places)))
    current = equations
    for _ in range(max(1, len(numbers) // MOST_SHARE)):
        trials = _trials(current, source)
        if not trials:
            return None
        worst, fit = trials[0]
        agreeing = [number for number, trial in trials if trial.likelihood >= CONTRADICTS]
        current = current.without(worst)
        left.append(numbers.pop(worst))
        if len(agreeing) > 1:
            return None
        if agreeing:
            notes = [_wrong(equations.places[number], fit, source) for number in left]
            scale = current.scale(fit)
            return _Choice(current, fit, left, scale, [*notes, *_scale_notes(scale, source)])
    return None


def _trials(equations: PlaceEquations, source: KnownAlignment) -> list[tuple[int, RigidFit]]:
    """Fits without one place each, with its number, that one first without which the others agree best."""
    fits = equations.fits()
    if not fits or len(equations.places) < 3:
        return []
    deviations = [fits[0].deviation(equations.rows(k)) for k in range(len(equations.places))]
    suspects = np.argsort(deviations)[::-1][:SUSPECTS].tolist()
    trials: list[tuple[int, RigidFit]] = []
    for number in suspects:
        try:
            trials.append((number, _determined(equations.without(number), source)))
        except SiteError:
            continue
    surplus = [trial for trial in trials if len(trial[1].residuals) > 3]
    return sorted(surplus, key=lambda trial: -trial[1].likelihood)


def _wrong(place: KnownPlace, fit: RigidFit, source: KnownAlignment) -> str:
    off, deviation, _ = _prediction(place, fit)
    what = f"{place.name} is {np.linalg.norm(off):.3f} m ({deviation:.0f} sigmas) from where the other places say"
    return source.line(place.location, f"{what}; it is aligned without it")


def _scale_notes(scale: Measured | None, source: KnownAlignment) -> list[str]:
    if scale is None or abs(scale.value - 1) < OFF_SIGMA * scale.sigma:
        return []
    percent, sigma = 100 * (scale.value - 1), 100 * scale.sigma
    longer = "longer" if percent > 0 else "shorter"
    what = f"distances between the places are {abs(percent):.2f} % (sigma {sigma:.2f} %) {longer} than in the map"
    return [source.line((), f"{what}, whose scale stays as it is")]


def _contradiction(equations: PlaceEquations, fit: RigidFit) -> str:
    places = equations.places
    if len(places) == 2 and all(place.normal is None for place in places):
        given = float(np.linalg.norm(places[1].world - places[0].world))
        mapped = float(np.linalg.norm(equations.points[1] - equations.points[0]))
        return (
            f"the two points contradict the map: they are {given:.3f} m apart in your world and {mapped:.3f} m "
            f"in the map ({np.sqrt(fit.squares):.0f} sigmas); give a third one to tell which is wrong"
        )
    deviations = {place.name: fit.deviation(equations.rows(k)) for k, place in enumerate(places)}
    worst = sorted(deviations, key=lambda name: -deviations[name])[:3]
    named = ", ".join(f"{name} ({deviations[name]:.0f} sigmas)" for name in worst)
    return f"the places contradict one another, and it cannot be told which is wrong: {named}"


def _height(places: Sequence[KnownPlace], given: float, source: KnownAlignment) -> tuple[Floats, list[str]]:
    """The floor's height in the user's world and what is left of each place's height (1 + n,), NaN where none was
    given; and a line where heights contradict one another."""
    offsets = np.array([np.nan if p.height is None else p.height - p.place.position[2] for p in places])
    variances = np.array([place.sigma**2 + place.place.covariance[2, 2] for place in places])
    measured = ~np.isnan(offsets)
    if not measured.any():
        return np.array([given, *offsets]), []
    mean = float(np.average(offsets[measured], weights=1 / variances[measured]))
    left = offsets - mean
    squares = float((left[measured] ** 2 / variances[measured]).sum())
    if measured.sum() < 2 or chdtrc(measured.sum() - 1, squares) >= CONTRADICTS:
        return np.array([mean, *left]), []
    worst = int(np.nanargmax(np.abs(left) / np.sqrt(variances)))
    what = f"{places[worst].name} is {left[worst]:+.3f} m off in height, by what the other heights say"
    return np.array([mean, *left]), [source.line(places[worst].location, what)]


def _alignment(equations: PlaceEquations, choice: _Choice, height: Floats) -> Alignment:
    fit = choice.fit
    order = [1, 2, 0]
    units = np.array([1.0, 1.0, np.degrees(1.0)])
    covariance = choice.inflation * fit.covariance[np.ix_(order, order)] * np.outer(units, units)
    residuals = tuple(_residuals(equations, choice, height[1:]))
    x, y = fit.shift.tolist()
    heading = float(np.degrees(fit.heading_rad))
    return Alignment(x, y, heading, covariance, float(height[0]), residuals=residuals, scale=choice.scale)


def _residuals(equations: PlaceEquations, choice: _Choice, heights: Floats) -> Iterator[AlignmentResidual]:
    kept = [k for k in range(len(equations.places)) if k not in choice.left_out]
    for k, place in enumerate(equations.places):
        off, deviation, spread = _prediction(place, choice.fit)
        if k in kept:
            deviation = choice.fit.deviation(choice.used.rows(kept.index(k)))
        z_sigma = np.nan if np.isnan(heights[k]) else np.sqrt(place.sigma**2 + place.place.covariance[2, 2])
        sigmas = np.sqrt(np.diag(spread))
        residual, sigma = np.array([*off, heights[k]]), np.array([*sigmas, z_sigma])
        yield AlignmentResidual(place.place.row, place.place.at, residual, sigma, deviation, k in kept)


def _prediction(place: KnownPlace, fit: RigidFit) -> tuple[Floats, float, Floats]:
    """Where a place is given less where a fit that does not rest on it has it (2,), m; that in standard deviations; and
    the covariance (2, 2) of the place itself and of what was given."""
    cos, sin = np.cos(fit.heading_rad), np.sin(fit.heading_rad)
    turn = np.array([[cos, -sin], [sin, cos]])
    at = turn @ place.place.position[:2]
    across = place.axes.T @ place.axes
    off = across @ (place.world - at - fit.shift)
    spread = across @ (place.sigma**2 * np.eye(2) + turn @ place.place.covariance[:2, :2] @ turn.T) @ across
    slopes = np.array([[-at[1], 1.0, 0.0], [at[0], 0.0, 1.0]])
    whole = spread + across @ slopes @ fit.covariance @ slopes.T @ across
    squares = float(off @ np.linalg.pinv(whole) @ off)
    return off, max(squares, 0.0) ** 0.5, spread
