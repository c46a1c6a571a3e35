"""Where the site stands in the user's world by least squares: the turn and the shift that bring places of the map to
where they are known.

Unknown are the heading and the shift (x, y); the map's scale stays. The residual of a place is A (R p + t - w): p its
position in the map (2,), w where it is known, and A the directions along which it is known: both, or across a line. Its
covariance is the user's, that of the place in its row, and that of the row in the site, which the places of one row
have in common.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import block_diag
from scipy.special import chdtrc

from savmap.assembly.known_places import KnownPlace
from savmap.types import Floats, Measured, array_record

HEADINGS = 16
STEPS = 20
CONVERGED = 1e-9
"""Radians and metres."""
SAME_DEG = 0.5
LIKELY = 9.0
"""By how much the sum of squares of another heading may exceed the least one for it to be likely, too: three standard
deviations."""
WEAKEST = 1e-12
VAGUE_SCALE = 0.05
"""Standard deviation of a scale that is not worth telling."""
FLAT = 1e-6
"""Part of a place's variance below which the fit leaves nothing of it."""


@dataclass(frozen=True, eq=False)
@array_record
class RigidFit:
    """A turn and a shift with what is left: `covariance` (3, 3) of heading in radians, x m, y m; `residuals` (m,) m of
    the places' equations in turn, map less given, with their covariance (m, m) before the fit and derivatives (m,
    3)."""

    heading_rad: float
    shift: Floats
    covariance: Floats
    residuals: Floats
    noise: Floats
    slopes: Floats

    @cached_property
    def squares(self) -> float:
        """The weighted sum of squares."""
        return float(self.residuals @ np.linalg.solve(self.noise, self.residuals))

    @property
    def likelihood(self) -> float:
        """How likely so large a sum of squares, or a larger one, is by chance; 1 where nothing is left over to tell."""
        surplus = len(self.residuals) - 3
        return float(chdtrc(surplus, self.squares)) if surplus > 0 else 1.0

    def deviation(self, rows: slice) -> float:
        """A used place's residual in standard deviations."""
        left = self.noise[rows, rows] - self.slopes[rows] @ self.covariance @ self.slopes[rows].T
        values, vectors = np.linalg.eigh(left)
        kept = values > FLAT * float(np.trace(self.noise[rows, rows]))
        along = vectors.T[kept] @ self.residuals[rows]
        return float(np.sqrt((along**2 / values[kept]).sum()))


@dataclass(frozen=True, eq=False)
class PlaceEquations:
    """Equations of places; `placements`: covariances (3, 3) of rows in the site by name; `directed`: pairs of places
    that the given lines run past in this order."""

    places: Sequence[KnownPlace]
    placements: Mapping[str, Floats]
    directed: Sequence[tuple[int, int]] = ()

    def without(self, number: int) -> "PlaceEquations":
        """The same without one place."""
        places = [place for k, place in enumerate(self.places) if k != number]
        pairs = [(a - (a > number), b - (b > number)) for a, b in self.directed if number not in (a, b)]
        return PlaceEquations(places, self.placements, pairs)

    @cached_property
    def axes(self) -> Floats:
        """A (m, 2n) of all places."""
        matrix: Floats = block_diag(*(place.axes for place in self.places))
        return matrix

    @cached_property
    def points(self) -> Floats:
        """Positions (n, 2) in the map, m."""
        return np.array([place.place.position[:2] for place in self.places])

    @cached_property
    def world(self) -> Floats:
        """Where they are known (n, 2), m."""
        return np.array([place.world for place in self.places])

    def rows(self, number: int) -> slice:
        """Which equations are a place's."""
        first = sum(len(place.axes) for place in self.places[:number])
        return slice(first, first + len(self.places[number].axes))

    def fits(self) -> list[RigidFit]:
        """All that are likely, the likeliest first; several where the places fit in several ways."""
        fits: list[RigidFit] = []
        for rough in self._rough_headings():
            fit = self._descended(rough, self.noise(rough))
            fit = fit and self._descended(fit.heading_rad, self.noise(fit.heading_rad))
            if fit is not None and self._in_order(fit) and not any(_near(fit.heading_rad, f.heading_rad) for f in fits):
                fits.append(fit)
        fits.sort(key=lambda fit: fit.squares)
        return [fit for fit in fits if fit.squares < fits[0].squares + LIKELY]

    def _rough_headings(self) -> list[float]:
        """Headings that least squares may come to: that of points, in closed form; where there are lines, those that
        are come to from all sides, with a diagonal covariance that knows no direction."""
        variances = [place.sigma**2 + np.trace(place.place.covariance[:2, :2]) / 2 for place in self.places]
        if all(place.normal is None for place in self.places):
            weights = 1 / np.array(variances)
            mapped, given = (
                places - np.average(places, axis=0, weights=weights) for places in (self.points, self.world)
            )
            cross = mapped[:, 0] * given[:, 1] - mapped[:, 1] * given[:, 0]
            return [float(np.arctan2(weights @ cross, weights @ (mapped * given).sum(axis=1)))]
        noise = np.diag(np.repeat(variances, [len(place.axes) for place in self.places]))
        headings: list[float] = []
        for heading in np.linspace(-np.pi, np.pi, HEADINGS, endpoint=False).tolist():
            rough = self._descended(heading, noise)
            if rough is not None and not any(_near(rough.heading_rad, other) for other in headings):
                headings.append(rough.heading_rad)
        return headings

    def scale(self, fit: RigidFit) -> Measured | None:
        """How much longer the user's distances are than the map's, near a fit; None where the places do not tell."""
        turn, middle = _turn(fit.heading_rad), self.points.mean(axis=0)
        column = self.axes @ ((self.points - middle) @ turn.T).ravel()
        whitening = np.linalg.inv(np.linalg.cholesky(fit.noise))
        slopes = whitening @ np.column_stack([fit.slopes, column])
        covariance = _inverse(slopes.T @ slopes)
        sigma = float(np.sqrt(covariance[3, 3]))
        step = -covariance @ slopes.T @ whitening @ fit.residuals
        return Measured(1.0 + float(step[3]), sigma) if sigma < VAGUE_SCALE else None

    def likelihood_with(self, fit: RigidFit, scale: Measured) -> float:
        """How likely the sum of squares is where the scale is free, too; 0 where nothing is left over to tell."""
        surplus = len(fit.residuals) - 4
        squares = fit.squares - ((scale.value - 1) / scale.sigma) ** 2
        return float(chdtrc(surplus, max(squares, 0.0))) if surplus > 0 else 0.0

    def noise(self, heading_rad: float) -> Floats:
        """Covariance (m, m) m^2 of the residuals."""
        turn = _turn(heading_rad)
        blocks = [
            place.sigma**2 * np.eye(len(place.axes))
            + place.axes @ turn @ place.place.covariance[:2, :2] @ turn.T @ place.axes.T
            for place in self.places
        ]
        whole: Floats = block_diag(*blocks)
        for row, covariance in self.placements.items():
            moved = np.vstack(
                [place.axes @ turn @ place.place.slopes[:2] * (place.place.row == row) for place in self.places]
            )
            whole += moved @ covariance @ moved.T
        return whole

    def spread(self, fit: RigidFit) -> tuple[float, float]:
        """Standard deviations of the heading, radians, and of where the places' middle stands, m, along the worst
        direction."""
        middle = self.points.mean(axis=0)
        at_middle = np.eye(3)
        at_middle[1:, 0] = _turned_by(fit.heading_rad) @ middle
        covariance = at_middle @ fit.covariance @ at_middle.T
        return float(np.sqrt(covariance[0, 0])), float(np.sqrt(np.linalg.eigvalsh(covariance[1:, 1:])[-1]))

    def _descended(self, heading_rad: float, noise: Floats) -> RigidFit | None:
        """The fit that least squares come to from a heading, with this covariance of the residuals; None where they
        come to none."""
        shift = self.world.mean(axis=0) - _turn(heading_rad) @ self.points.mean(axis=0)
        for _ in range(STEPS):
            step = self._step(self._at(heading_rad, shift, noise))
            heading_rad = _wrapped(heading_rad + step[0])
            shift = shift + step[1:]
            if np.abs(step).max() < CONVERGED:
                break
        return self._at(heading_rad, shift, noise) if np.isfinite(shift).all() else None

    def _step(self, fit: RigidFit) -> Floats:
        """The next step of Gauss and Newton; about the places' middle, so that the shift follows the turn."""
        step: Floats = -fit.covariance @ fit.slopes.T @ np.linalg.solve(fit.noise, fit.residuals)
        turned = np.clip(step[0], -0.5, 0.5)
        middle = self.points.mean(axis=0)
        at_middle = step[1:] + _turned_by(fit.heading_rad) @ middle * step[0]
        shift = at_middle - (_turn(fit.heading_rad + turned) - _turn(fit.heading_rad)) @ middle
        return np.array([turned, *shift])

    def _at(self, heading_rad: float, shift: Floats, noise: Floats) -> RigidFit:
        residuals = self.axes @ (self.points @ _turn(heading_rad).T + shift - self.world).ravel()
        turned = self.axes @ (self.points @ _turned_by(heading_rad).T).ravel()
        slopes = np.column_stack([turned, self.axes @ np.tile(np.eye(2), (len(self.places), 1))])
        covariance = _inverse(slopes.T @ np.linalg.solve(noise, slopes))
        return RigidFit(heading_rad, shift, covariance, residuals, noise, slopes)

    def _in_order(self, fit: RigidFit) -> bool:
        """Whether the given lines run past their places in the order in which they were named."""
        turn = _turn(fit.heading_rad)
        for first, last in self.directed:
            normal = self.places[first].normal
            along = turn @ (self.points[last] - self.points[first])
            if normal is not None and along @ np.array([normal[1], -normal[0]]) < 0:
                return False
        return True


def _inverse(information: Floats) -> Floats:
    """The inverse of a symmetric matrix, of which directions that it does not know have a large variance."""
    scale = np.sqrt(np.maximum(np.diag(information), WEAKEST))
    values, vectors = np.linalg.eigh(information / np.outer(scale, scale))
    inverse: Floats = (vectors / np.maximum(values, WEAKEST)) @ vectors.T / np.outer(scale, scale)
    return inverse


def _turn(angle: float) -> Floats:
    cos, sin = np.cos(angle), np.sin(angle)
    return np.array([[cos, -sin], [sin, cos]])


def _turned_by(angle: float) -> Floats:
    """The derivative of a turn by its angle."""
    cos, sin = np.cos(angle), np.sin(angle)
    return np.array([[-sin, -cos], [cos, -sin]])


def _wrapped(angle: float) -> float:
    return float((angle + np.pi) % (2 * np.pi) - np.pi)


def _near(first: float, second: float) -> bool:
    return bool(abs(_wrapped(first - second)) < np.radians(SAME_DEG))
