"""What a plugin's `constrain` returned is checked before GTSAM's solver uses it."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import gtsam
import numpy as np
import pytest

from savmap.errors import PluginFailedError
from savmap.graph import (
    Constraints,
    KeySpace,
    check_jacobians,
    equal_coordinate,
    fixed_coordinate,
    frame_key,
    graph_of,
    image_measurements,
    require_valid_constraints,
)
from savmap.plugin.hookspecs import hookimpl
from savmap.plugin.isolation import isolated
from savmap.plugin.manager import loaded_plugin
from savmap.types import Floats

from . import made_up_wall as made

SPACE = KeySpace("stripes")
CORNER, THING, SIZE = SPACE.point(0), SPACE.pose2(0), SPACE.vector3(0)
FOREIGN = KeySpace("wall").point(0)
UNIT3, UNIT6 = (gtsam.noiseModel.Isotropic.Sigma(size, 1.0) for size in (3, 6))
Error = Callable[[gtsam.CustomFactor, gtsam.Values, list[Any] | None], Any]


def constraints(*factors: gtsam.NonlinearFactor, **changes: Any) -> Constraints:
    """One corner, and factors about it."""
    plain = Constraints(
        "stripes", {"corner": CORNER}, image_measurements((), {}, {}), (), {"corner": np.array([1.0, 0.0, 0.5])}
    )
    return replace(plain, factors=graph_of(factors), **changes)


def custom(error: Error, *keys: int) -> gtsam.CustomFactor:
    return gtsam.CustomFactor(UNIT3, list(keys or (CORNER,)), error)


def given(jacobian: Any, error: Any = (0.0, 0.0, 0.0)) -> gtsam.CustomFactor:
    """A factor on the corner with such an error and Jacobian."""

    def errors(_: object, values: gtsam.Values, jacobians: list[Any] | None) -> Any:
        if jacobians is not None and jacobian is not None:
            jacobians[0] = jacobian
        return np.array(error)

    return custom(errors)


def raising(_: object, values: gtsam.Values, jacobians: list[Any] | None) -> Floats:
    raise KeyError("oh")


def leaving(_: object, values: gtsam.Values, jacobians: list[Any] | None) -> Floats:
    raise SystemExit(0)


def one_too_many(_: object, values: gtsam.Values, jacobians: list[Any] | None) -> Floats:
    if jacobians is not None:
        jacobians[0] = np.eye(3)
        jacobians.append(np.eye(3))
    return np.zeros(3)


def swapped(_: object, values: gtsam.Values, jacobians: list[Any] | None) -> Floats:
    """As many columns in all as there should be, but each variable has the other's."""
    if jacobians is not None:
        jacobians[0], jacobians[1] = np.zeros((3, 3)), np.zeros((3, 6))
    return np.zeros(3)


POSE = gtsam.Pose3(made.path().world_from_rig[0])
REFUSED = {
    r"binds p\d+, which is not its own": gtsam.BetweenFactorPoint3(CORNER, FOREIGN, np.zeros(3), UNIT3),
    r"places the camera: it binds one frame's pose": gtsam.PriorFactorPose3(frame_key(0), POSE, UNIT6),
    r"gives an error that is not finite": given(np.eye(3), (0.0, np.nan, 0.0)),
    r"gives a Jacobian by p\d+ that is not finite": given(np.full((3, 3), np.inf)),
    r"gives no Jacobian by p\d+, where \(3, 3\) is expected": given(None),
    r"gives a Jacobian \(2, 2\) by p\d+, not \(3, 3\)": given(np.eye(2)),
    r"gives a Jacobian \(3, 3\) by x0, not \(3, 6\)": custom(swapped, frame_key(0), CORNER),
    r"gives 2 errors, but its noise model has dimension 3": given(np.zeros((2, 3)), (0.0, 0.0)),
    r"gives 2 Jacobians for 1 variables": custom(one_too_many),
    r"fails: KeyError: 'oh'": custom(raising),
    r"fails: SystemExit: 0": custom(leaving),
}


@pytest.mark.parametrize("flaw", REFUSED)
def test_a_factor_is_refused(flaw: str) -> None:
    with pytest.raises(PluginFailedError, match=rf"^plugin `stripes` returned a factor \(\w+\) that {flaw}") as raised:
        require_valid_constraints("stripes", constraints(REFUSED[flaw]), made.path())
    assert (raised.value.plugin, raised.value.hook) == ("stripes", "constrain")


@pytest.mark.parametrize(
    ("what", "changes"),
    [
        ("a relation between landmarks that are not its own", {"relations": (equal_coordinate("z", CORNER, FOREIGN),)}),
        ("a relation between landmarks that", {"alternatives": {"part": (fixed_coordinate("x", FOREIGN),)}}),
        ("a relation of nan", {"relations": (fixed_coordinate("x", CORNER, float("nan")),)}),
        ("a relation of 0.0 .- 0.0 m", {"relations": (fixed_coordinate("x", CORNER, sigma=0.0),)}),
        ("coordinates of landmarks that are not its own", {"coordinates": {"edge": ("x", FOREIGN)}}),
        ("keys that are not of `KeySpace", {"keys": {"corner": FOREIGN}}),
        ("no finite first position .3,. of landmark 'corner'", {"initial": {"corner": np.full(3, np.nan)}}),
        ("constraints of 'wall'", {"plugin": "wall"}),
    ],
)
def test_constraints_are_refused(what: str, changes: dict[str, Any]) -> None:
    with pytest.raises(PluginFailedError, match=f"plugin `stripes` returned {what}"):
        require_valid_constraints("stripes", replace(constraints(), **changes), made.path())


def test_valid_factors_pass() -> None:
    factors = (
        gtsam.BetweenFactorPose3(frame_key(0), frame_key(1), gtsam.Pose3(), UNIT6),
        gtsam.PriorFactorPose2(THING, gtsam.Pose2(), UNIT3),
        gtsam.BetweenFactorPoint3(CORNER, SIZE, np.zeros(3), gtsam.noiseModel.Diagonal.Precisions(np.eye(3)[1])),
        given(np.eye(3)),
    )
    require_valid_constraints(
        "stripes", constraints(*factors, variables={THING: gtsam.Pose2(), SIZE: np.ones(3)}), made.path()
    )


def test_a_failing_factor_is_isolated() -> None:
    """With `on_plugin_error: skip` the plugin is left out, as after any other failure."""

    class Reaching(made.Stripes):
        @hookimpl
        def constrain(self) -> Constraints:
            return constraints(gtsam.BetweenFactorPoint3(CORNER, FOREIGN, np.zeros(3), UNIT3))

    room = loaded_plugin("stripes", Reaching, made.Config())
    with pytest.raises(PluginFailedError, match="is not its own"):
        room.constrain(tracks=[], facts=made.FACTS, start=made.path())
    (safe,) = isolated([room])
    nothing = safe.constrain(tracks=[], facts=made.FACTS, start=made.path())
    assert len(nothing.keys) == 0
    assert "is not its own" in str(safe.failure)


def wrong_by(share: float) -> gtsam.CustomFactor:
    """The corner in the rig, whose derivative by the corner is wrong by a share."""

    def error(factor: gtsam.CustomFactor, values: gtsam.Values, jacobians: list[Any] | None) -> Floats:
        pose, point = values.atPose3(frame_key(2)), values.atPoint3(CORNER)
        local = pose.transformTo(point)
        if jacobians is not None:
            x, y, z = local
            skew = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
            jacobians[0] = np.hstack([skew, -np.eye(3)])
            jacobians[1] = (1 + share) * pose.rotation().matrix().T
        return np.asarray(local)

    return custom(error, frame_key(2), CORNER)


def test_jacobians_are_checked_numerically() -> None:
    lines = check_jacobians(constraints(wrong_by(0.0), given(np.zeros((3, 3))), wrong_by(0.05)), made.path())
    assert len(lines) == 1
    assert lines[0].startswith("factor 2 (CustomFactor): its Jacobian differs from the derivative by")
