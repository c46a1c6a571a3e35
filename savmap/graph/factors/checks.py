"""Checks of what a plugin's `constrain` returned, before GTSAM's solver uses it.

The solver would not notice: a factor over another plugin's keys moves its structures, a NaN spoils the whole solution,
and a Jacobian of the wrong shape ends the process. GTSAM hands a factor's Jacobians to Python as they are
(`JacobianVector`), so that they can be checked without the C++ code that relies on them.
"""

from collections.abc import Iterator

import gtsam
import numpy as np

from savmap.errors import PluginFailedError, format_error
from savmap.graph.constraints import Constraints, Relation, factors_in
from savmap.graph.keys import KeySpace, frame_key, is_frame, value_at, width_of
from savmap.types import Floats, Trajectory

STEP = 1e-6
JACOBIAN_TOLERANCE = 1e-3
"""Central differences with this step are good to about 1e-7 of the largest entry where a factor is smooth."""
BOUND_BY = "its factors and relations bind its own landmarks and variables, and factors camera poses as well"


class _FactorError(Exception):
    """What is wrong with a factor, to be read after "returned a factor that"."""


def require_valid_constraints(plugin: str, constraints: Constraints, start: Trajectory) -> None:
    """Check the factors, relations and first values that a plugin's `constrain` returned for the first poses `start`.

    Factors and relations must bind the plugin's own keys, and factors frames' poses too, but no factor a single pose
    alone. At the first values every factor must have a finite error of its noise model's dimension, and finite
    Jacobians (dimension, 6) by a frame's pose, (dimension, 3) by any other variable. Factors of frames without a first
    pose are not evaluated.

    Raises PluginFailedError with the first thing that is wrong.
    """
    for what in _flaws(plugin, constraints, start):
        raise PluginFailedError(plugin, "constrain", f"returned {what} from `constrain`")


def check_jacobians(constraints: Constraints, start: Trajectory) -> list[str]:
    """A line about each factor whose Jacobians are not its numerical derivatives at the first values, for
    `check_plugin`. The constraints must have passed `require_valid_constraints`."""
    values = first_values(constraints, start)
    lines = []
    for number, factor in enumerate(factors_in(constraints.factors)):
        if isinstance(factor, gtsam.NoiseModelFactor) and all(map(values.exists, factor.keys())):
            difference = jacobian_difference(factor, values)
            if difference > JACOBIAN_TOLERANCE:
                what = f"factor {number} ({type(factor).__name__})"
                lines.append(f"{what}: its Jacobian differs from the derivative by {difference:.1%}")
    return lines


def jacobian_difference(factor: gtsam.NoiseModelFactor, values: gtsam.Values) -> float:
    """The largest difference of a factor's Jacobians from central differences of its error, as a part of their largest
    entry."""
    _, given = _evaluated(factor, values)
    numeric = [_derivative(factor, values, key) for key in list(factor.keys())]
    size = max(float(np.abs(block).max(initial=0.0)) for block in numeric)
    return max(float(np.abs(a - b).max(initial=0.0)) for a, b in zip(given, numeric, strict=True)) / max(size, STEP)


def first_values(constraints: Constraints, start: Trajectory) -> gtsam.Values:
    """First values of the plugin's landmarks and variables, and of all frames."""
    values = gtsam.Values()
    for frame, pose in zip(start.frames.tolist(), start.world_from_rig, strict=True):
        values.insert(frame_key(frame), gtsam.Pose3(pose))
    for name, key in constraints.keys.items():
        values.insert(key, np.asarray(constraints.initial[name], np.float64))
    for key, value in constraints.variables.items():
        values.insert(key, value)
    return values


def _flaws(plugin: str, constraints: Constraints, start: Trajectory) -> Iterator[str]:
    if constraints.plugin != plugin:
        yield f"constraints of '{constraints.plugin}'"
    space = KeySpace(plugin)
    if not all(map(space.holds, (*constraints.keys.values(), *constraints.variables))):
        yield f"keys that are not of `KeySpace('{plugin}')`"
    for name in constraints.keys:
        first = np.asarray(constraints.initial[name])
        if first.shape != (3,) or not np.isfinite(first).all():
            yield f"no finite first position (3,) of landmark '{name}'"
    landmarks = set(constraints.keys.values())
    alternatives = (relation for relations in constraints.alternatives.values() for relation in relations)
    for relation in (*constraints.relations, *alternatives):
        yield from _relation_flaws(relation, landmarks)
    if not {key for _, key in constraints.coordinates.values()} <= landmarks:
        yield f"coordinates of landmarks that are not its own: {BOUND_BY}"
    if constraints.factors is not None:
        yield from _factor_flaws(constraints, first_values(constraints, start))


def _relation_flaws(relation: Relation, landmarks: set[int]) -> Iterator[str]:
    named = f" '{relation.name}'" if relation.name else ""
    if not set(relation.keys) <= landmarks:
        yield f"a relation{named} between landmarks that are not its own: {BOUND_BY}"
    if not (np.isfinite(relation.value) and 0 < relation.sigma < np.inf):
        yield f"a relation{named} of {relation.value} +- {relation.sigma} m"
    if relation.axis is None and relation.b is None:
        yield f"a relation{named} of one landmark without an axis"


def _factor_flaws(constraints: Constraints, values: gtsam.Values) -> Iterator[str]:
    allowed = {*constraints.keys.values(), *constraints.variables}
    for factor in factors_in(constraints.factors):
        try:
            _require_allowed_keys(factor, allowed)
            if all(map(values.exists, factor.keys())):
                _evaluated(factor, values)
        except _FactorError as flaw:
            yield f"a factor ({type(factor).__name__}) that {flaw}"


def _require_allowed_keys(factor: gtsam.NonlinearFactor, allowed: set[int]) -> None:
    keys = {*factor.keys()}
    foreign = sorted(key for key in keys if key not in allowed and not is_frame(key))
    if foreign:
        raise _FactorError(f"binds {gtsam.DefaultKeyFormatter(foreign[0])}, which is not its own: {BOUND_BY}")
    if len(keys) == 1 and is_frame(*keys):
        raise _FactorError(
            "places the camera: it binds one frame's pose and nothing else, which only references may do"
        )


def _evaluated(factor: gtsam.NonlinearFactor, values: gtsam.Values) -> tuple[Floats, list[Floats]]:
    """A factor's error (n,) and Jacobians (n, width) by its keys, as they should be. Raises _FactorError otherwise."""
    try:
        if not isinstance(factor, gtsam.NoiseModelFactor):
            return np.array([factor.error(values)]), [factor.linearize(values).jacobian()[0]]
        blocks = gtsam.JacobianVector([np.zeros((0, 0))] * factor.size())
        error = np.asarray(factor.unwhitenedError(values, blocks), np.float64)
        jacobians = [np.asarray(block) for block in blocks]
    except (Exception, SystemExit) as raised:
        raise _FactorError(f"fails: {format_error(raised)}") from raised
    noise = factor.noiseModel()
    if noise is not None and error.shape != (noise.dim(),):
        raise _FactorError(f"gives {len(error)} errors, but its noise model has dimension {noise.dim()}")
    if not np.isfinite(error).all():
        raise _FactorError("gives an error that is not finite at the first values")
    if len(jacobians) != factor.size():
        raise _FactorError(f"gives {len(jacobians)} Jacobians for {factor.size()} variables")
    for key, jacobian in zip(list(factor.keys()), jacobians, strict=True):
        _require_jacobian(jacobian, (len(error), width_of(key)), gtsam.DefaultKeyFormatter(key))
    return error, jacobians


def _require_jacobian(jacobian: Floats, shape: tuple[int, int], name: str) -> None:
    if not jacobian.size:
        raise _FactorError(f"gives no Jacobian by {name}, where {shape} is expected")
    if jacobian.shape != shape:
        raise _FactorError(f"gives a Jacobian {jacobian.shape} by {name}, not {shape}")
    if not np.isfinite(jacobian).all():
        raise _FactorError(f"gives a Jacobian by {name} that is not finite at the first values")


def _derivative(factor: gtsam.NoiseModelFactor, values: gtsam.Values, key: int) -> Floats:
    """Numerical derivative (n, width) of a factor's error by a variable, in GTSAM's tangent."""
    columns = []
    for step in STEP * np.eye(width_of(key)):
        errors, value = [], value_at(values, key)
        for side in (step, -step):
            moved = gtsam.Values(values)
            moved.update(key, value + side if isinstance(value, np.ndarray) else value.retract(side))
            errors.append(np.asarray(factor.unwhitenedError(moved)))
        columns.append((errors[0] - errors[1]) / (2 * STEP))
    return np.stack(columns, axis=1)
