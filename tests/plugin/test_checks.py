"""What a hook returns is checked: the plugin and the hook are named, and `on_plugin_error: skip` covers it."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from savmap.errors import PluginError, PluginFailedError
from savmap.plugin.hookspecs import REQUIRED
from savmap.plugin.isolation import isolated
from savmap.plugin.manager import LoadedPlugin, loaded_plugin
from savmap.types import (
    Distances,
    MapWarning,
    Measured,
    Score,
    Solid,
    Structure,
    SurveyEntry,
    ViewPlan,
)

from .made_up_plugin import (
    CALLS,
    CONSTRAINTS,
    DETECTION,
    FEATURE,
    FLAT,
    FRONT,
    LANDMARK,
    MASK,
    SPEC,
    THING,
    TRACK,
    Config,
    loaded,
    plugin_class,
)

NAN = float("nan")
SKEW = np.array([[1.0, 0.5, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])


def with_attribute(value: Any) -> list[Structure]:
    return [replace(THING, attributes={"size": value})]


SOLID = Solid(np.eye(3), np.ones(3), assumed=True, ifc_class="IfcBeam")
FAULTS: list[tuple[str, Any, str]] = [
    ("render_views", ViewPlan((SPEC, SPEC)), "2 views with the name `view`"),
    (
        "detect",
        [replace(DETECTION, mask=MASK[1:], probability=MASK[1:])],
        r"its mask is \(11, 16\), its view \(12, 16\)",
    ),
    ("extract_features", [replace(FEATURE, frame=4)], "it is of frame 4, its view of frame 3"),
    ("extract_features", [replace(FEATURE, view="side")], "it is of view `side`, not of `view`"),
    ("track", [replace(TRACK, pixels=np.full((1, 2), NAN))], "track `thing 1`: a pixel is not finite"),
    ("track", [replace(TRACK, covariances=np.full((1, 2, 2), np.inf))], "a covariance is not finite"),
    ("track", [replace(TRACK, covariances=np.zeros((1, 2, 2)))], "a covariance is not positive definite"),
    ("track", [replace(TRACK, frames=np.array([5]))], r"no frame \[5\] in the row, which has 5"),
    ("track", [replace(TRACK, frames=np.array([0.5]))], "frames are not whole numbers"),
    ("track", [replace(TRACK, views=("side",))], "no view `side` in the row"),
    ("track", [TRACK, TRACK], "2 tracks with the name `thing 1`"),
    ("flat_parts", [replace(FLAT, landmark="other")], "flat parts at `other`: the plugin has no such landmark"),
    ("flat_parts", [FLAT, FLAT], "2 answers for the depth of `thing 1, z`"),
    ("flat_parts", [replace(FLAT, parts=(FRONT, FRONT))], "2 planes with the name `front`"),
    (
        "constrain",
        replace(CONSTRAINTS, measurements=replace(CONSTRAINTS.measurements, pixels=np.full((1, 2), NAN))),
        "a measured pixel is not finite",
    ),
    (
        "describe",
        [Structure("empty", "light", np.zeros((0, 3)), np.zeros((0, 3, 3)), (), np.zeros((0, 2), np.int64))],
        "structure `empty`: it has no vertex",
    ),
    ("describe", [replace(THING, vertices=np.full((1, 3), NAN))], "structure `thing 1`: a vertex is not finite"),
    ("describe", [replace(THING, covariances=np.full((1, 3, 3), NAN))], "a covariance is not finite"),
    ("describe", [replace(THING, covariances=-np.eye(3)[None])], "a variance is negative"),
    ("describe", [replace(THING, edges=np.array([[0, 1]]))], "an edge joins a vertex that is not there"),
    ("describe", [replace(THING, vertices=np.full((1, 3), 1e200))], "a vertex is more than 100000 m away"),
    ("describe", [replace(THING, solid=replace(SOLID, ifc_class="Beam"))], "'Beam' is no class of IFC"),
    ("describe", [replace(THING, solid=replace(SOLID, depth=np.full(3, 1e6)))], "a corner of its solid is more than"),
    ("describe", [replace(THING, vertices=np.full((1, 3), 1j))], "a vertex is not finite"),
    ("describe", [replace(THING, covariances=np.full((1, 3, 3), 1e200))], "a standard deviation is more than 100000 m"),
    ("describe", [replace(THING, covariances=SKEW[None])], "a covariance is not symmetric"),
    ("describe", [replace(THING, covariances=(2 * np.ones((3, 3)) - np.eye(3))[None])], "a negative eigenvalue"),
    ("describe", [replace(THING, edges=np.array([[0.0, 0.5]]))], "edges are not whole numbers"),
    ("describe", [THING, THING], "2 structures with the id `thing 1`"),
    ("describe", with_attribute(NAN), "attribute `size` is not finite"),
    ("describe", with_attribute(np.inf), "attribute `size` is not finite"),
    ("describe", with_attribute([1, 2]), "attribute `size` is a list, no number or text"),
    ("describe", with_attribute(None), "attribute `size` is a NoneType, no number or text"),
    ("relate", [], "0 structures for 1"),
    ("relate", [replace(THING, id="other")], "structure `other` in the place of `thing 1`"),
    ("relate", with_attribute({}), "attribute `size` is a dict"),
    ("warnings", [MapWarning("uncertain-element", ("thing 2",))], "thing 2"),
    ("survey_entry", SurveyEntry({}, {"thing 2": "who?"}), "`thing 2` is left out, which was not given"),
    ("survey_entry", SurveyEntry({"x": NAN}), "not JSON compliant"),
    ("survey_entry", SurveyEntry({"x": np.zeros(3)}), "not JSON serializable"),
    ("cross_row_landmarks", [replace(LANDMARK, id="other")], "landmark `other`: no structure has that id"),
    ("evaluate", Score(distances={"things": Distances(np.array([NAN]))}), "an error of `things` is not finite"),
    ("evaluate", Score(deviations={"thing 1": NAN}), "the deviation of `thing 1` is not a number"),
]


def answering(hook: str, answer: Any) -> LoadedPlugin:
    return loaded(**{hook: lambda self=None: answer})


@pytest.mark.parametrize("value", [np.float64(0.5), "red", 3, Measured(2.5, 0.01)])
def test_numbers_and_texts_are_attributes(value: Any) -> None:
    assert len(CALLS["describe"](answering("describe", with_attribute(value)))) == 1


@pytest.mark.parametrize(("hook", "answer", "fault"), FAULTS)
def test_a_faulty_answer_names_plugin_and_hook(hook: str, answer: Any, fault: str) -> None:
    with pytest.raises(
        PluginFailedError, match=f"plugin `made-up` returned what cannot be used from `{hook}`.*{fault}"
    ):
        CALLS[hook](answering(hook, answer))


@pytest.mark.parametrize(("hook", "answer"), {hook: answer for hook, answer, _ in FAULTS}.items())
def test_a_faulty_answer_is_contained_where_failures_are(hook: str, answer: Any) -> None:
    (plugin,) = isolated([answering(hook, answer)])
    CALLS[hook](plugin)
    assert plugin.failure is not None
    assert plugin.failure.hook == hook


@pytest.mark.parametrize("hook", CALLS)
def test_a_hook_that_ends_the_program_has_failed(hook: str) -> None:
    def leave(self: Any) -> None:
        raise SystemExit(0)

    with pytest.raises(PluginFailedError, match=f"plugin `made-up` failed in `{hook}`.*: SystemExit: 0"):
        CALLS[hook](loaded(**{hook: leave}))


def test_an_interrupt_by_the_user_is_no_failure_of_the_plugin() -> None:
    def interrupted(self: Any) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        CALLS["extract_features"](loaded(extract_features=interrupted))


@pytest.mark.parametrize("hook", REQUIRED)
def test_a_plugin_without_a_required_hook_is_refused(hook: str) -> None:
    with pytest.raises(PluginError, match=f"plugin `made-up` cannot be used: it lacks the hook `{hook}`"):
        loaded_plugin("made-up", plugin_class(leave_out=(hook,)), Config())


def test_a_plugin_that_ends_the_program_as_it_is_made_is_refused() -> None:
    def leave(self: Any, config: Config) -> None:
        raise SystemExit(0)

    with pytest.raises(PluginError, match="plugin `made-up` cannot be set up: SystemExit: 0"):
        loaded_plugin("made-up", type("Leaving", (plugin_class(),), {"__init__": leave}), Config())
