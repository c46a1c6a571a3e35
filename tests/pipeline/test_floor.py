"""The floor on its way from the pictures to the solve: the camera's height alone gives the scale, whatever hides the feet of what stands on it."""

from dataclasses import replace

import pytest

from savmap import graph
from savmap.errors import SolveError
from savmap.graph import CameraHeight, References, camera_priors
from savmap.graph.factors.scene import FLOOR_REFERENCE, without_presumed
from savmap.pipeline.records import LocatedRow, PosedRow, RowMeasurements, RowRequest, TrackedRow
from savmap.pipeline.row import constrain, track
from savmap.types import Trajectory
from savmap.types.progress import SilentMonitor
from savmap.vision.evidence import FloorTracks
from savmap.vision.markers import MarkerTracks

from ..graph import made_up_wall as made

FLOOR = FloorTracks(
    tuple(made.track(f"floor {number}", point, "floor") for number, point in enumerate(made.CORNERS, 1)),
    {made.VIEW: made.SPEC},
    0.002,
)
HEIGHT = CameraHeight(1.5, 0.01)


def posed(floor: FloorTracks, references: References, path: Trajectory | None = None) -> PosedRow:
    """A row of posts on a wall, without feet, whose camera's path starts with a wrong scale."""
    start = made.path(1.3)
    seen = RowMeasurements(made.FACTS, {"wall": []}, {}, frozenset({"wall"}), (), MarkerTracks((), {}), floor=floor)
    request = RowRequest("A", (), made.rooms(known=False)[:1], references, path=path)
    row = LocatedRow(request, seen, start, camera_priors(made.FACTS, start, references))
    tracked: TrackedRow = track(row, SilentMonitor())
    return constrain(tracked, SilentMonitor())


def test_the_cameras_height_over_the_floor_gives_the_scale() -> None:
    solution = graph.solve(posed(FLOOR, References((HEIGHT,))).problem)
    found = solution.landmarks_of("wall")
    wide = found["post 14"].position - found["post 0"].position
    assert wide == pytest.approx(made.WALL[14] - made.WALL[0], abs=0.02)
    assert [reference.name for reference in solution.references] == [HEIGHT.name, FLOOR_REFERENCE]
    assert solution.references[1].sigma == pytest.approx(0.002 * HEIGHT.value_m)


def test_without_a_floor_the_cameras_height_gives_no_scale() -> None:
    with pytest.raises(SolveError, match="a camera height alone does not give it"):
        graph.solve(posed(FloorTracks(), References((HEIGHT,))).problem)


def test_an_earlier_maps_path_needs_no_floor() -> None:
    row = posed(FLOOR, References(), path=made.path())
    assert not any(part.plugin == "floor" for part in row.camera_constraints)


def test_what_a_plugin_takes_for_granted_of_heights_gives_way() -> None:
    """With the landmark that is there for it."""
    (part,) = posed(FLOOR, References((HEIGHT,))).camera_constraints
    seen, second = part.relations[0], part.keys["floor 2"]
    presumed = replace(seen, a=second, presumed="feet may be hidden")
    along = replace(seen, a=part.keys["floor 3"], presumed="of no matter here", axis="x")
    left = without_presumed(replace(part, relations=(seen, presumed, along)))
    assert left.relations == (seen, along)
    assert set(part.keys) - set(left.keys) == set(part.initial) - set(left.initial) == {"floor 2"}
    assert second not in left.measurements.keys
