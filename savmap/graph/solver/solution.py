"""What the solve gives back: landmarks, trajectory and references' tests, from an estimate and its covariance."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from savmap.errors import SolveError
from savmap.geometry.poses import columns_at, poses_at
from savmap.graph.covariance import Covariance
from savmap.graph.initial.observability import require_known
from savmap.graph.keys import Variable
from savmap.graph.problem import Estimate, Problem
from savmap.graph.solver.judgement.reference_tests import (
    GROSS_SIGMA,
    ReferenceTest,
    off_by,
    refuse_contradiction,
)
from savmap.graph.solver.residuals import DirectionalErrors, Fit, directional_errors
from savmap.types import Floats, MapWarning, ReferenceUse, Trajectory

WARN_SIGMA = 3.0
VAGUE_SCALE = 0.015
MANY_REJECTED = 0.25
DRIFT_M = 0.05
LEAST_DISTANCE_M = 0.01
MISFIT, NONSENSE = 5.0, 100.0
"""How many times as far off as they should be measurements are that are warned of, and those that say nothing."""
LEAST_DEVIATION, LEAST_DISPLACEMENT_M = 4.5, 0.006
"""Pictures are bent at a seam where the parts of the lens distance deviate from 0 by more than so much, which chance
does in one row of a thousand, and move the point of view of some ray by more than so much: lenses of one camera stand
2 cm apart and more, each 1 cm from its middle. What moves it less is no seam, such as beams behind the posts' face."""


@dataclass(frozen=True, eq=False)
class Landmark:
    """A solved point: position (3,) m in the row's frame, covariance (3, 3) m^2, the number of used measurements.
    offsets (k,): the distance of each measurement from the point, m; used ones first, then rejected ones. Of a
    measurement on an edge it is the distance across that edge."""

    position: Floats
    covariance: Floats
    observations: int
    offsets: Floats = field(default_factory=lambda: np.zeros(0))


@dataclass(frozen=True)
class VerticalScaleError:
    """The share by which a row's panoramas show all elevations too large, and its standard deviation."""

    share: float
    sigma: float

    @property
    def report(self) -> dict[str, float]:
        """Its entries in the row's report."""
        return {"elevations, percent": 100 * self.share, "elevations, sigma percent": 100 * self.sigma}


@dataclass(frozen=True)
class LensDistanceError:
    """The distance between the lenses that a row's panoramas show at their seam, and its standard deviation, m.
    `displacement_m`: the farthest that it moves the point of view of a ray from the camera's middle. `deviation`: the
    Mahalanobis distance from 0 of its parts, one for each of `BENDS`; some may cancel in the sum."""

    distance_m: float
    sigma_m: float
    displacement_m: float
    deviation: float

    @property
    def significant(self) -> bool:
        """Whether the pictures are bent at a seam."""
        return self.deviation > LEAST_DEVIATION and self.displacement_m > LEAST_DISPLACEMENT_M

    @property
    def report(self) -> dict[str, float]:
        """Its entries in the row's report."""
        return {
            "lens distance, cm": 100 * self.distance_m,
            "lens distance, sigma cm": 100 * self.sigma_m,
            "lens distance, deviation": self.deviation,
        }


@dataclass(frozen=True, eq=False)
class Solution:
    """Trajectory, landmarks by plugin and name, the references as they were used, and notes for the user.

    `deviations`: by how many standard deviations each reference, by name, deviates from the rest. `variables`: the
    plugins' variables by key (see `Constraints`); `variable_covariance` has their covariances. `warnings`: what speaks
    against it. `unchecked`: errors of references that nothing would notice. `directional`: by plugin, what is off in
    the same directions of the camera in all frames.
    `vertical_scale`: by how much elevations are seen too large, and `lens_distance`: how far apart the seam shows the
    lenses; None where no solve told it."""

    trajectory: Trajectory
    landmarks: Mapping[str, Mapping[str, Landmark]]
    references: tuple[ReferenceUse, ...]
    notes: tuple[str, ...]
    report: Mapping[str, float | int | str]
    keys: Mapping[str, Mapping[str, int]]
    covariance: Covariance
    deviations: Mapping[str, float]
    variables: Mapping[int, Variable] = field(default_factory=dict)
    warnings: tuple[MapWarning, ...] = ()
    unchecked: tuple[str, ...] = ()
    directional: Mapping[str, DirectionalErrors] = field(default_factory=dict)
    vertical_scale: VerticalScaleError | None = None
    lens_distance: LensDistanceError | None = None

    def landmarks_of(self, plugin: str) -> Mapping[str, Landmark]:
        """Landmarks of a plugin by name; none of one that has none."""
        return self.landmarks.get(plugin, {})

    def variable_covariance(self, key: int) -> Floats:
        """Covariance (3, 3) of a plugin's variable, in GTSAM's tangent: of a Pose2 x, y in its own axes (m) and its
        turn (rad)."""
        return self.covariance.of([key])

    def joint(self, plugin: str, names: Sequence[str]) -> Floats:
        """Joint covariance (3n, 3n) m^2 of some landmarks of a plugin, x y z of each in turn."""
        return self.covariance.of([self.keys[plugin][name] for name in names])

    def difference_sigma(self, plugin: str, first: str, second: str, axis: int) -> float:
        """Standard deviation in m of the distance between two landmarks along an axis: a width, a height."""
        joint = self.joint(plugin, [first, second])
        other = 3 + axis
        return float(np.sqrt(max(joint[axis, axis] + joint[other, other] - 2 * joint[axis, other], 0.0)))


def build_solution(
    problem: Problem,
    estimate: Estimate,
    fit: Fit,
    covariance: Covariance,
    tests: Sequence[ReferenceTest],
    inflation: Mapping[str, float],
    bias: Floats,
    notes: tuple[str, ...],
    figures: Mapping[str, float | str],
) -> Solution:
    """Put the results together; `notes` go first, `figures` after the report. Raises SolveError if references
    contradict one another grossly, or if they leave the scale open."""
    refuse_contradiction(problem, tests)
    share = 1.0 - float(fit.kept.mean()) if len(fit.kept) else 0.0
    sigma = scale_sigma(problem, estimate, covariance)
    directional = directional_errors(problem, estimate, fit)
    if problem.camera.fixed is None:
        require_known(problem, sigma)
    return Solution(
        trajectory=trajectory(problem, estimate, np.sqrt(np.maximum(covariance.cameras, 0.0))),
        landmarks=_landmarks(problem, estimate, fit, covariance),
        references=tuple(test.use for test in tests),
        notes=(*notes, *_notes(tests, share, sigma)),
        report={
            "observations": len(fit.kept),
            "rejected": int((~fit.kept).sum()),
            "rejected_share": share,
            "residual_scale": fit.scale,
            "scale_sigma": sigma,
            **inflation,
            "frames": len(problem.used),
            "landmarks": len(problem.keys),
            **{f"directional {name}, deg": off.angle_deg for name, off in directional.items()},
            **{f"directional {name}, share": off.share for name, off in directional.items()},
            **dict(_biases(problem, bias, covariance)),
            **figures,
        },
        keys={part.plugin: part.keys for part in problem.parts},
        covariance=covariance,
        deviations={test.use.name: test.deviation for test in tests},
        variables=estimate.variables,
        warnings=(*_misfits(problem, fit), *_contradicted(tests)),
        directional=directional,
    )


def _contradicted(tests: Sequence[ReferenceTest]) -> Iterator[MapWarning]:
    """A warning about each reference that the solve contradicts."""
    for test in tests:
        if test.deviation > GROSS_SIGMA:
            off = abs(test.predicted - test.use.value)
            figure = off_by(off, off / test.deviation)
            yield MapWarning("reference-conflict", (test.use.name,), figure, details=(test.line,), size=off)


def _misfits(problem: Problem, fit: Fit) -> Iterator[MapWarning]:
    """A warning about each class of measurements that hardly agree: errors so large or so many are none of measuring.
    Raises SolveError where they say nothing at all."""
    for number, name in enumerate(problem.measurements.class_names):
        of_class = problem.measurements.classes == number
        rejected = 1.0 - float(fit.kept[of_class].mean()) if of_class.any() else 0.0
        times = float(fit.scales[of_class].max(initial=0.0))
        if rejected > MANY_REJECTED or times > MISFIT:
            line = (
                f"what was measured of `{name}` does not fit together: {rejected:.0%} of its pixels fit nothing, and "
                f"the others are off {times:.1f} times as far as they should be"
            )
            if times > NONSENSE:
                raise SolveError(f"row {problem.camera.facts.name}: {line}: are these whole panoramas, of one aisle?")
            yield MapWarning("bad-panorama", (name,), f"{rejected:.0%} rejected", details=(line,), size=rejected)


def _biases(problem: Problem, bias: Floats, covariance: Covariance) -> Iterator[tuple[str, float]]:
    """The plugins' biases that were estimated, with their standard deviations."""
    count = len(bias) - (len(problem.camera.calibration.names) if problem.camera.calibration else 0)
    for number in np.flatnonzero(problem.measurements.biases.free[:count]).tolist():
        yield f"bias {number + 1}, px", float(bias[number])
        yield f"bias {number + 1}, sigma px", float(np.sqrt(covariance.shared[number, number]))


def _landmarks(
    problem: Problem, estimate: Estimate, fit: Fit, covariance: Covariance
) -> dict[str, dict[str, Landmark]]:
    used = np.bincount(problem.at_key[fit.kept], minlength=len(problem.keys))
    order = np.lexsort((~fit.kept, problem.at_key))
    ends = np.searchsorted(problem.at_key[order], np.arange(1, len(problem.keys)))
    offsets = np.split(_offsets(problem, estimate, fit)[order], ends)
    slot = {key: 3 * index for index, key in enumerate(covariance.keys)}

    def landmark(key: int) -> Landmark:
        index, first = problem.index(key), slot[key]
        block = covariance.points[first : first + 3, first : first + 3]
        return Landmark(estimate.points[index], block, int(used[index]), offsets[index])

    return {part.plugin: {name: landmark(key) for name, key in part.keys.items()} for part in problem.parts}


def _offsets(problem: Problem, estimate: Estimate, fit: Fit) -> Floats:
    """The distance (n,) of each measurement from its landmark, m: that in pixels, at the landmark's distance."""
    measurements = problem.measurements
    focal = np.array([spec.camera[0, 0] for spec in measurements.views])[measurements.view]
    away = np.linalg.norm(estimate.points[problem.at_key] - estimate.poses[problem.at_frame, :3, 3], axis=1)
    return np.asarray(pixels_off(problem, fit) * away / focal)


def pixels_off(problem: Problem, fit: Fit) -> Floats:
    """How far (n,) each measurement is off, px: the Mahalanobis norm of its error times its least standard
    deviation."""
    least = np.sqrt(np.linalg.eigvalsh(problem.measurements.covariances)[:, 0])
    return np.asarray(np.linalg.norm(fit.errors, axis=1) * least)


def trajectory(problem: Problem, estimate: Estimate, sigma: Floats | None = None) -> Trajectory:
    """Solved frames, whose positions have standard deviations `sigma` (f, 3), and those between them: interpolated
    within a pass, with a sigma that grows with the gap."""
    table = problem.camera.facts.frames
    frames, poses, sigmas = [], [], []
    for of_pass in problem.passes():
        if not len(of_pass):
            continue
        solved = problem.used[of_pass]
        numbers = table.of_pass(table.passes[int(solved[0])])
        wanted = numbers[(numbers >= solved[0]) & (numbers <= solved[-1])]
        between = poses_at(wanted, solved, estimate.poses[of_pass])
        between[np.isin(wanted, solved)] = estimate.poses[of_pass]
        frames.append(wanted)
        poses.append(between)
        if sigma is not None:
            gap = np.abs(wanted[:, None] - solved).min(axis=1)[:, None]
            sigmas.append(columns_at(wanted, solved, sigma[of_pass]) + DRIFT_M * gap)
    order = np.argsort(np.concatenate(frames), kind="stable")
    spread = np.concatenate(sigmas)[order] if sigma is not None else None
    return Trajectory(np.concatenate(frames)[order], np.concatenate(poses)[order], spread)


def scale_sigma(problem: Problem, estimate: Estimate, covariance: Covariance) -> float:
    """Relative standard deviation of the scale: that of the best distance along the aisle from the row's origin."""
    slots = {key: 3 * index for index, key in enumerate(covariance.keys)}
    order = [slots[int(key)] for key in problem.keys]
    sigma = np.sqrt(np.maximum(np.diag(covariance.points)[order], 0.0))
    distance = np.abs(estimate.points[:, 0])
    far = distance > LEAST_DISTANCE_M
    return float((sigma[far] / distance[far]).min()) if far.any() else 0.0


def _notes(tests: Sequence[ReferenceTest], share: float, sigma: float) -> Iterator[str]:
    if sigma > VAGUE_SCALE:
        yield f"the references give the scale to +-{sigma:.1%} only: a known length would help"
    yield from (test.line for test in tests if test.deviation > WARN_SIGMA)
    if share > MANY_REJECTED:
        yield f"{share:.0%} of the measurements did not fit and were left out"
