"""What a plugin declares and is given, so that it need not write it out: the path it needs, its keys, its landmarks,
sigmas."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from savmap.errors import PluginError, StructureError
from savmap.files.journal import Journal
from savmap.graph import Constraints, KeySpace, Landmark, References, camera_priors, image_measurements
from savmap.maps.map_file import map_of, map_text
from savmap.pipeline.records import LocatedRow, RowMeasurements, RowRequest, TrackedRow
from savmap.pipeline.row import measure, track
from savmap.plugin.manager import LoadedPlugin
from savmap.report.page.uncertainty import _hint
from savmap.types import FrameTable, Measured, RowMap, SiteMap, Structure, Trajectory
from savmap.types.progress import SilentMonitor
from savmap.vision.markers import MarkerTracks

from .made_up_plugin import FACTS, PATH, SOLVED, loaded


def asked_to_track(plugin: LoadedPlugin, path: Trajectory | None) -> TrackedRow:
    measurements = RowMeasurements(FACTS, {"made-up": []}, {}, frozenset(), (), MarkerTracks((), {}))
    request = RowRequest("A", (), [plugin], References(), path=path)
    priors = camera_priors(FACTS, PATH, References())
    return track(LocatedRow(request, measurements, PATH, priors), SilentMonitor())


def test_a_plugin_that_needs_a_path_is_refused_by_the_engine() -> None:
    plugin = loaded(needs_path=True, track=lambda self: pytest.fail("it was asked"))
    with pytest.raises(
        StructureError, match="row A: `made-up` alone does not locate the camera: add a plugin that maps"
    ):
        asked_to_track(plugin, None)


def test_it_is_refused_before_a_picture_is_decoded() -> None:
    row = RowRequest("A", (), [loaded(needs_path=True)], References())
    (error,) = measure([row], Journal(), SilentMonitor())
    assert isinstance(error, StructureError)
    assert "`made-up` alone does not locate the camera" in str(error)


@pytest.mark.parametrize("needs", [True, False])
def test_with_a_path_it_is_asked(needs: bool) -> None:
    def refuse(self: object, start: Trajectory | None) -> None:
        raise StructureError(f"start is known: {start is not None}")

    with pytest.raises(StructureError, match="start is known: True"):
        asked_to_track(loaded(needs_path=needs, track=refuse), PATH)


def test_constrain_is_given_keys_of_the_plugins_own() -> None:
    given: list[KeySpace] = []

    def constrain(self: object, tracks: Any, facts: Any, keys: KeySpace) -> Constraints:
        given.append(keys)
        return Constraints("made-up", {}, image_measurements([], {}, facts.views), (), {})

    loaded(constrain=constrain).constrain([], FACTS, PATH)
    assert given == [KeySpace("made-up")]


def test_describe_is_given_the_plugins_own_landmarks() -> None:
    landmark = Landmark(np.zeros(3), np.eye(3), 4)

    class Solved:
        def landmarks_of(self, plugin: str) -> dict[str, Landmark]:
            return {"thing 1": landmark} if plugin == "made-up" else {}

    given: list[Any] = []
    loaded(describe=lambda self, landmarks: given.append(landmarks) or []).describe([], FACTS, Solved())  # type: ignore[arg-type]
    assert given == [{"thing 1": landmark}]


def thing(**attributes: Any) -> Structure:
    return Structure(
        "thing 1", "thing", np.zeros((1, 3)), np.eye(3)[None], ("foot",), np.empty((0, 2), np.int64), attributes
    )


def test_an_attribute_with_a_sigma_is_written_and_read() -> None:
    described = loaded(describe=lambda self: [thing(height_m=Measured(2.5, 0.01), number=3)])
    (structure,) = described.describe([], FACTS, SOLVED)
    row = RowMap("A", FrameTable(np.zeros(0), ()), {}, empty_path(), {"made-up": (structure,)}, ())
    text = map_text(SiteMap({"A": row}, {}))
    assert '"height_m": {\n        "sigma": 0.01,\n        "value": 2.5\n       }' in text
    (read,) = map_of(text, "map").rows["A"].structures["made-up"]
    assert read.attributes == {"height_m": Measured(2.5, 0.01), "number": 3}
    assert float(read.attributes["height_m"]) == 2.5
    assert "height 2.500 \u00b1 0.010 m" in _hint(read, read.assumed("posts", None), None)


def empty_path() -> Trajectory:
    return replace(PATH, frames=np.zeros(0, np.int64), world_from_rig=np.zeros((0, 4, 4)))


@pytest.mark.parametrize(("value", "sigma"), [(float("nan"), 0.1), (1.0, float("inf")), (1.0, -0.1)])
def test_a_sigma_that_cannot_be_is_a_fault_of_the_plugin(value: float, sigma: float) -> None:
    plugin = loaded(describe=lambda self: [thing(height_m=Measured(value, sigma))])
    with pytest.raises(PluginError, match="plugin `made-up` failed in `describe`: ValueError: Measured: "):
        plugin.describe([], FACTS, SOLVED)
