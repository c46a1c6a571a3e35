"""The camera's path by what single frames show of uprights: on masks' edges with their errors, up to scale."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from savmap.errors import StructureError
from savmap.lab.sim.drive.cart import Drive, drive
from savmap.lab.sim.observations import PAPER
from savmap.lab.sim.scene.build import build
from savmap.lab.sim.scene.files import parse_scene
from savmap.types import Feature, Floats, FrameTable, RowFacts, Trajectory, ViewSpec
from savmap_shelves.lab.observed import observe, observed_features
from savmap_shelves.locate import locate

VIEW = ViewSpec("shelf", yaw_deg=-90.0, hfov_deg=130.0)
BACK = replace(VIEW, name="shelf back", yaw_deg=90.0)
TURNED = 0.001
"""rad; how far attitudes are off, in each axis."""
Row = tuple[list[Feature], RowFacts, Floats, Floats]
"""Features, facts, attitudes (n, 3, 3), and the camera's true places (n, 3)."""


def driven(start: tuple[float, float], end: tuple[float, float], seed: int, sections: int = 4) -> Row:
    """A pass along bays of different widths."""
    rng = np.random.default_rng(5)
    bays = [
        {"width": 2.6 + 0.2 * (number % 2), "beams": (rng.uniform(0.3, 1.0) + np.array([0.0, 1.1, 2.2])).tolist()}
        for number in range(sections)
    ]
    back = end[0] < start[0]
    cart = {"start": start, "end": end, "height": 2.0, "frames": 60, "sway": 0.06, "speed_variation": 0.3}
    content = {
        "seed": seed,
        "hall": {"x": [-8.0, 20.0], "z": [-4.0, 5.0], "height": 6.0},
        "goods": {"density": 0.0},
        "cart": cart,
        "rows": {"A": {"x": 0.0, "z": 0.0}},
        "structures": {"shelves": {"rows": {"A": {"bays": bays, "height": 4.0, "setback": 0.0}}}},
    }
    scene, view = parse_scene(content), BACK if back else VIEW
    path: Drive = drive(scene.cart, seed)
    edges = observe(build(scene), "A", path, view, PAPER, seed)
    features = [replace(f, object="") for frame in edges for f in observed_features(frame, view)]
    count = len(path.stamps_s)
    facts = RowFacts(
        "A", FrameTable(path.stamps_s, ("pass 1",) * count), {view.name: view}, {"pass 1": -1 if back else 1}
    )
    return features, facts, path.world_from_rig, path.origins


def located(row: Row) -> Trajectory:
    features, facts, attitudes, _ = row
    rng = np.random.default_rng(1)
    turns = np.tile(np.eye(3), (len(attitudes), 1, 1))
    x, y, z = TURNED * rng.normal(size=3)
    turns += np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    left, _, right = np.linalg.svd(turns)
    return locate(features, facts, left @ right @ attitudes)


def off(path: Trajectory, places: Floats) -> float:
    """RMS of the path's places (m), laid on the true ones by scale and by a shift along and up the face, as a share of the distance."""
    found = path.world_from_rig[:, :3, 3]
    scale = float((places[:, 2] @ found[:, 2]) / (found[:, 2] @ found[:, 2]))
    left = places - scale * found
    left[:, :2] -= left[:, :2].mean(axis=0)
    return float(np.sqrt(np.square(left).sum(axis=1).mean()) / np.median(places[:, 2]))


@pytest.fixture(scope="module")
def row() -> Row:
    return driven((-0.5, 1.5), (11.5, 1.5), 3)


def joined(first: Row, second: Row) -> Row:
    """Two passes of one row."""
    count = len(first[3])
    features = [*first[0], *(replace(f, frame=f.frame + count) for f in second[0])]
    stamps = np.concatenate([first[1].frames.stamps_s, second[1].frames.stamps_s])
    frames = FrameTable(stamps, ("pass 1",) * count + ("pass 2",) * len(second[3]))
    facts = RowFacts(
        "A",
        frames,
        {**first[1].views, **second[1].views},
        {"pass 1": first[1].travel["pass 1"], "pass 2": second[1].travel["pass 1"]},
    )
    return features, facts, np.concatenate([first[2], second[2]]), np.concatenate([first[3], second[3]])


def test_the_path_is_right_to_a_hundredth_of_the_distance(row: Row) -> None:
    path = located(row)
    assert path.frames.tolist() == list(range(60))
    assert off(path, row[3]) < 0.01
    turn = np.einsum("nij,nik->njk", path.world_from_rig[:, :3, :3], row[2])
    assert np.degrees(np.arccos(np.clip((np.trace(turn, axis1=1, axis2=2) - 1) / 2, -1, 1))).max() < 0.7


def test_frames_that_show_nothing_are_bridged(row: Row) -> None:
    features, *rest = row
    kept = [f for f in features if f.frame not in {20, 21, 22, 31}]
    assert off(located((kept, *rest)), row[3]) < 0.02


def test_two_passes_are_laid_on_one_another(row: Row) -> None:
    both = joined(row, driven((11.5, 2.2), (-0.5, 2.2), 4))
    assert off(located(both), both[3]) < 0.02


def test_passes_with_no_bay_in_common_are_refused() -> None:
    first, second = (driven((x, 1.5), (x + 4, 1.5), 3, sections=2) for x in (-0.5, 14.0))
    with pytest.raises(StructureError, match=r"passes \d and \d do not show enough of the same bays"):
        located(joined(first, second))


def frames_of(features: Sequence[Feature], frames: set[int]) -> list[Feature]:
    return [f for f in features if f.frame in frames]


def test_what_does_not_show_a_row_is_refused(row: Row) -> None:
    features, facts, attitudes, _ = row
    with pytest.raises(StructureError, match="no upright was found in any of 60 frames"):
        locate([], facts, attitudes)
    with pytest.raises(StructureError, match="2 frames only"):
        locate(frames_of(features, {20, 21}), facts, attitudes)
    first = [f for f in features if f.label != "upright" or f.instance == 0]
    with pytest.raises(StructureError, match="no picture shows two uprights"):
        locate(first, facts, attitudes)
    still = [replace(f, frame=frame) for f in frames_of(features, {20}) for frame in range(60)]
    with pytest.raises(StructureError, match="too little motion"):
        locate(still, facts, np.tile(attitudes[20], (60, 1, 1)))
