"""Objects that the plugin finds: their ids, outlines and probabilities."""

from collections.abc import Callable

import numpy as np
import pytest
from painted_face import DISTANCE, HEIGHT, LEVELS, POSTS, PaintedFace

from savmap.errors import StructureError
from savmap.types import FoundObject, FrameTable, PlaneEvidence, PlanePatch, RowFacts, Trajectory, ViewSpec
from savmap_shelves.find import find

FRAMES = 10
VIEW = ViewSpec("pass 1 / face", 0.0, hfov_deg=110.0, width=640, height=640)
FACTS = RowFacts("A", FrameTable(np.arange(FRAMES) / 4, ("pass 1",) * FRAMES), {VIEW.name: VIEW}, {"pass 1": 1})
Gather = Callable[[PlanePatch], PlaneEvidence]


def path() -> Trajectory:
    poses = np.tile(np.diag([1.0, -1.0, -1.0, 1.0]), (FRAMES, 1, 1))
    poses[:, :3, 3] = np.column_stack([np.linspace(1, 8, FRAMES), np.full(FRAMES, HEIGHT), np.full(FRAMES, DISTANCE)])
    return Trajectory(np.arange(FRAMES), poses)


def showing(paint: Callable[[PlanePatch], PaintedFace], asked: list[PlanePatch] | None = None) -> Gather:
    def gather(patch: PlanePatch) -> PlaneEvidence:
        if asked is not None:
            asked.append(patch)
        return paint(patch).evidence()

    return gather


def found(paint: Callable[[PlanePatch], PaintedFace], floor: float | None = None) -> dict[str, FoundObject]:
    return {thing.id: thing for thing in find(showing(paint), path(), {}, FACTS, floor)}


def test_objects_have_the_ids_of_their_structures_and_outlines_in_the_rows_frame() -> None:
    objects = found(lambda patch: PaintedFace(patch=patch))
    assert [*objects] == [f"upright {n}" for n in range(1, 5)] + [
        f"bay {bay} / beam {n}" for bay in range(1, 4) for n in range(1, 4)
    ]
    assert {thing.label for name, thing in objects.items() if "beam" in name} == {"beam"}
    post, beam = objects["upright 2"].outline, objects["bay 2 / beam 3"].outline
    assert [post[:, 0].min(), post[:, 0].max()] == pytest.approx(POSTS[1], abs=0.01)
    assert post[:, 1].min() < 0.2
    assert post[:, 1].max() > 3.6
    assert [beam[:, 1].min(), beam[:, 1].max()] == pytest.approx(LEVELS[2], abs=0.01)
    assert [beam[:, 0].min(), beam[:, 0].max()] == pytest.approx([POSTS[1][1], POSTS[2][0]], abs=0.01)
    assert not post[:, 2].any()
    assert all(thing.is_mapped and thing.probability > 0.99 for thing in objects.values())


def test_what_may_exist_is_named_by_its_place_and_not_mapped() -> None:
    def paint(patch: PlanePatch) -> PaintedFace:
        face = PaintedFace(patch=patch, sections=(LEVELS, LEVELS[::2], LEVELS))
        return face.draw("beam", (3.4, 6.0), LEVELS[1], 0.25)

    objects = found(paint)
    unsure = objects["bay 2 / above beam 1, 1"]
    assert 0.01 < unsure.probability < 0.5
    assert not unsure.is_mapped
    assert objects["bay 2 / beam 2"].outline[:, 1].mean() == pytest.approx(np.mean(LEVELS[2]), abs=0.01)


def test_what_lies_below_the_floor_is_not_found() -> None:
    objects = found(lambda patch: PaintedFace(patch=patch), floor=1.0)
    assert {name for name in objects if name.startswith("bay 1")} == {"bay 1 / beam 1", "bay 1 / beam 2"}


def test_beams_are_looked_for_at_the_depth_that_was_solved() -> None:
    asked: list[PlanePatch] = []
    gather = showing(lambda patch: PaintedFace(patch=patch), asked)
    find(gather, path(), {}, FACTS, None)
    assert [patch.origin[2] for patch in asked] == [0.0]
    points = {f"bay 1 / beam {n} / lower left": np.array([0.0, 1.0, -0.02]) for n in range(3)}
    objects = find(gather, path(), points, FACTS, None)
    assert [patch.origin[2] for patch in asked[1:]] == pytest.approx([0.0, -0.02])
    assert {thing.label: thing.outline[0, 2] for thing in objects} == pytest.approx({"upright": 0.0, "beam": -0.02})


@pytest.mark.parametrize(
    ("posts", "message"), [(POSTS[:1], "fewer than two uprights"), (POSTS, "4 uprights but no beam")]
)
def test_where_no_bay_shows_the_row_is_told_so(posts: tuple[tuple[float, float], ...], message: str) -> None:
    with pytest.raises(StructureError, match=f"row A: {message}"):
        found(lambda patch: PaintedFace(patch=patch, posts=posts, sections=((),) * (len(posts) - 1)))
