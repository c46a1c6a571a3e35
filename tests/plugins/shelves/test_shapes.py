"""The shapes of uprights and beams: measured beside the solved map, whatever the frames' poses are off by."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
import pytest

from savmap.geometry.pinhole import project
from savmap.types import Floats, FrameTable, Measured, RowFacts, Structure, Track, Trajectory, ViewSpec
from savmap_shelves.inspection.shapes import BOW, LEAN, SAG, TILT, shapes_of, straightened, with_shapes

UPRIGHTS, FRAMES, SIGMA_PX = (0.0, 2.8, 5.6, 8.4), 40, 0.2
BEAMS, TOP, PARTS = (0.4, 2.0, 3.6), 3.7, 8
SIDES = {"upright": ("left", "right"), "beam": ("lower", "upper")}
SPEC = ViewSpec("face", 0.0, hfov_deg=110.0, width=1280, height=960)
FACTS = RowFacts("A", FrameTable(np.arange(FRAMES) / 5, ("pass 1",) * FRAMES), {"face": SPEC}, {"pass 1": 1})
FACING = np.diag([1.0, -1.0, -1.0])
"""world_from_rig (3, 3) of a camera that looks at the face."""


@dataclass(frozen=True)
class Bent:
    """By member, its slope (mm in 1 m) and its bow (m) across it."""

    slopes: Mapping[str, float] = field(default_factory=dict)
    bows: Mapping[str, float] = field(default_factory=dict)

    def moved(self, name: str, along: Floats, ends: tuple[float, float]) -> Floats:
        way = 2 * (along - sum(ends) / 2) / (ends[1] - ends[0])
        slope = self.slopes.get(name, 0.0) / 1000 * (along - sum(ends) / 2)
        return np.asarray(slope + self.bows.get(name, 0.0) * (1 - way**2))


def poses(roll: Floats) -> Floats:
    """world_from_rig (n, 4, 4) of a drive along the face, rolled by angles (n,) rad."""
    made = np.tile(np.eye(4), (FRAMES, 1, 1))
    for k, angle in enumerate(roll):
        cos, sin = np.cos(angle), np.sin(angle)
        made[k, :3, :3] = np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1.0]]) @ FACING
        made[k, :3, 3] = 8.4 * k / (FRAMES - 1), 2.0, 2.2
    return made


def members() -> list[tuple[str, str, tuple[float, float], tuple[float, float]]]:
    """Id, label, the ends along, and the edges across each member, m."""
    standing = [(f"upright {k}", "upright", (0.0, TOP), (x, x + 0.1)) for k, x in enumerate(UPRIGHTS, 1)]
    lying = [
        (f"bay {bay} / beam {k}", "beam", (UPRIGHTS[bay - 1] + 0.1, UPRIGHTS[bay]), (y, y + 0.1))
        for bay in range(1, len(UPRIGHTS))
        for k, y in enumerate(BEAMS, 1)
    ]
    return standing + lying


def in_face(label: str, along: Floats, across: Floats) -> Floats:
    """Places (n, 3) m."""
    x, y = (across, along) if label == "upright" else (along, across)
    return np.stack([x, y, np.zeros_like(x)], axis=-1)


def structures() -> list[Structure]:
    """The members as the map has them: upright, level and straight."""
    made = []
    for name, label, ends, edges in members():
        corners = [(end, edge) for end in (0, 1) for edge in (0, 1)]
        vertices = np.array([in_face(label, np.array(ends[a]), np.array(edges[b])) for a, b in corners])
        labels = tuple(f"{name} / {SIDES[label][edge]}" for _, edge in corners)
        attributes = {"bay": int(name.split()[1])} if label == "beam" else {}
        covariances = np.tile(1e-6 * np.eye(3), (4, 1, 1))
        made.append(Structure(name, label, vertices, covariances, labels, np.zeros((0, 2), np.int64), attributes))
    return made


def parts(bent: Bent, seed: int = 4) -> tuple[list[Track], Trajectory]:
    """Tracks of the parts of a rack's edges, and the solved path: its frames are rolled by 3 mrad at random."""
    rng = np.random.default_rng(seed)
    true, solved = poses(np.zeros(FRAMES)), poses(0.003 * rng.normal(size=FRAMES))
    tracks = []
    for name, label, ends, edges in members():
        along = ends[0] + (ends[1] - ends[0]) * (np.arange(PARTS) + 0.5) / PARTS
        for side, edge in zip(SIDES[label], edges, strict=True):
            places = in_face(label, along, edge + bent.moved(name, along, ends))
            near = np.flatnonzero(np.abs(true[:, 0, 3] - places[:, 0].mean()) < 3.5)
            pixels = np.concatenate([seen(places, true[k]) for k in near])
            pixels += rng.normal(scale=SIGMA_PX, size=pixels.shape)
            place = place_of(name, side)
            frames, views = np.repeat(near, PARTS), ("face",) * len(pixels)
            covariances = np.tile(SIGMA_PX**2 * np.eye(2), (len(pixels), 1, 1))
            tracks.append(Track(f"parts of {name} / {side}", label, place, frames, views, pixels, covariances))
    return tracks, Trajectory(np.arange(FRAMES), solved)


def seen(places: Floats, pose: Floats) -> Floats:
    return project((places - pose[:3, 3]) @ pose[:3, :3] @ SPEC.rig_from_view, SPEC.camera)


def place_of(name: str, side: str) -> dict[str, int | str]:
    numbers = [int(word) for word in name.split() if word.isdigit()]
    if len(numbers) == 1:
        return {"upright": numbers[0], "side": side, "end": "part"}
    return {"bay": numbers[0], "beam": numbers[1], "edge": side, "end": "part"}


def measured(bent: Bent, tracks: list[Track] | None = None) -> dict[str, dict[str, Measured]]:
    made, path = parts(bent)
    shapes = shapes_of(structures(), tracks or made, FACTS, path, {})
    return {
        name: {key: value for key, value in each.items() if isinstance(value, Measured)}
        for name, each in shapes.items()
    }


ALL_LEAN = {f"upright {k}": 5.0 for k in range(1, 5)}


@pytest.mark.parametrize("lean", [{}, {"upright 2": 8.0}, {"upright 1": 6.0, "upright 4": -6.0}, ALL_LEAN])
def test_each_upright_has_its_lean(lean: dict[str, float]) -> None:
    shapes = measured(Bent(lean))
    assert len(shapes) == len(members())
    for number in range(1, 5):
        value = shapes[f"upright {number}"][LEAN]
        assert value.value == pytest.approx(lean.get(f"upright {number}", 0.0), abs=0.5)
        assert 0.8 < value.sigma < 1.2, "beams tell where down is, and floors are not level"


def test_uprights_are_bowed_and_beams_sag() -> None:
    shapes = measured(Bent(bows={"upright 2": 0.02, "bay 2 / beam 2": -0.015}))
    assert shapes["upright 2"][BOW].value == pytest.approx(1000 * 0.02 / TOP, abs=0.3)
    assert shapes["upright 3"][BOW].value == pytest.approx(0.0, abs=0.3)
    assert shapes["bay 2 / beam 2"][SAG].value == pytest.approx(0.015, abs=0.001)
    assert shapes["bay 2 / beam 1"][SAG].value == pytest.approx(0.0, abs=0.001)
    assert 0.0006 < shapes["bay 2 / beam 2"][SAG].sigma < 0.0015


def test_a_beam_that_hangs_askew_turns_no_uprights() -> None:
    shapes = measured(Bent({"bay 2 / beam 2": 12.0}))
    assert shapes["bay 2 / beam 2"][TILT].value == pytest.approx(12.0, abs=1.5)
    assert shapes["upright 2"][LEAN].value == pytest.approx(0.0, abs=0.8)


def test_what_differs_from_place_to_place_is_in_the_sigma() -> None:
    """At one end of a beam something else is taken for its upper edge in all frames."""
    tracks, _ = parts(Bent())
    for k, track in enumerate(tracks):
        if track.name == "parts of bay 1 / beam 2 / upper":
            pixels = track.pixels.copy()
            pixels[::PARTS, 1] += 6.0
            tracks[k] = replace(track, pixels=pixels)
    shapes = measured(Bent(), tracks)
    assert shapes["bay 1 / beam 2"][SAG].sigma > 2 * shapes["bay 1 / beam 1"][SAG].sigma
    assert abs(shapes["bay 1 / beam 2"][SAG].value) < 3 * shapes["bay 1 / beam 2"][SAG].sigma


def test_a_member_that_few_frames_show_has_no_shape() -> None:
    tracks, path = parts(Bent())
    few = [
        replace(
            track,
            frames=track.frames[: 5 * PARTS],
            views=track.views[: 5 * PARTS],
            pixels=track.pixels[: 5 * PARTS],
            covariances=track.covariances[: 5 * PARTS],
        )
        if track.place.get("upright") == 4
        else track
        for track in tracks
    ]
    assert "upright 4" not in shapes_of(structures(), few, FACTS, path, {})
    assert shapes_of(structures(), [], FACTS, path, {}) == {}


def test_only_attributes_change() -> None:
    tracks, path = parts(Bent({"upright 2": 8.0}))
    before = structures()
    after = with_shapes(before, tracks, FACTS, path, {})
    assert [part.id for part in after] == [part.id for part in before]
    for old, new in zip(before, after, strict=True):
        keys = {LEAN, BOW} if new.label == "upright" else {TILT, SAG}
        assert set(new.attributes) - set(old.attributes) == keys
        assert np.array_equal(old.vertices, new.vertices)


def ends_of(number: int, lean: float, path: Trajectory) -> Track:
    """The track of the tops of an upright's left edge, m of lean in 1 m about its middle."""
    x, pixels = UPRIGHTS[number - 1], []
    for pose in poses(np.zeros(FRAMES)):
        pixels.append(seen(np.array([[x + lean * TOP / 2, TOP, 0.0]]), pose)[0])
    frames = path.frames.astype(np.int64)
    place = {"upright": number, "side": "left", "end": "top"}
    views, covariances = ("face",) * FRAMES, np.tile(np.eye(2), (FRAMES, 1, 1))
    return Track(f"upright {number} / left / top", "upright", place, frames, views, np.array(pixels), covariances)


def test_what_leans_is_straightened_for_the_solve_and_all_else_is_left_bit_for_bit() -> None:
    tracks, path = parts(Bent({"upright 2": 8.0}))
    tops = [ends_of(2, 0.008, path), ends_of(3, 0.0, path)]
    leaning, upright, *others = straightened([*tops, *tracks], FACTS, path)
    plumb = ends_of(2, 0.0, path)
    before, after = (np.median(np.abs(track.pixels - plumb.pixels)[:, 0]) for track in (tops[0], leaning))
    assert after < 0.25 * before
    assert upright is tops[1]
    assert all(new is old for new, old in zip(others, tracks, strict=True))


def glimpses(seed: int) -> tuple[list[Track], Trajectory]:
    """Tracks of parts of a few edges, of which each frame shows one place alone, centimetres beside the edge; and the
    solved path."""
    rng = np.random.default_rng(seed)
    tracks, path = parts(Bent())
    true, seldom = poses(np.zeros(FRAMES)), []
    for k in np.flatnonzero(rng.random(len(tracks)) < 0.3):
        track, ends, edges = tracks[k], *members_ends(tracks[k])
        frames = np.unique(track.frames)[: rng.integers(8, 14)]
        along = ends[0] + (ends[1] - ends[0]) * rng.random() + 0.01 * rng.normal(size=len(frames))
        across = edges[SIDES[track.label].index(str(track.place.get("side", track.place.get("edge"))))]
        places = in_face(track.label, along, across + 0.02 * rng.normal(size=len(frames)))
        pixels = np.concatenate([seen(place[None], true[frame]) for place, frame in zip(places, frames, strict=True)])
        views, covariances = ("face",) * len(frames), np.tile(SIGMA_PX**2 * np.eye(2), (len(frames), 1, 1))
        seldom.append(replace(track, frames=frames, views=views, pixels=pixels, covariances=covariances))
    return seldom, path


def members_ends(track: Track) -> tuple[tuple[float, float], tuple[float, float]]:
    """The ends along and the edges across the member that a track is of, m."""
    (found,) = [(ends, edges) for name, _, ends, edges in members() if track.name.startswith(f"parts of {name} / ")]
    return found


@pytest.mark.parametrize("seed", [2, 3, 11, 20, 150])
def test_glimpses_of_members_cost_no_track_and_lean_as_racks_do(seed: int) -> None:
    """Poses take up what one place a frame is off by: weights must not grow until nothing can be solved."""
    tracks, path = glimpses(seed)
    tops = [ends_of(k, 0.0, path) for k in (1, 2, 3, 4)]
    after = straightened([*tops, *tracks], FACTS, path)
    assert all(np.isfinite(track.pixels).all() for track in after)
    assert max(float(np.abs(new.pixels - old.pixels).max()) for new, old in zip(after, tops, strict=False)) < 200
    for shape in shapes_of(structures(), tracks, FACTS, path, {}).values():
        assert all(np.isfinite([float(value), value.sigma]).all() for value in shape.values())  # type: ignore[union-attr]
        assert all(abs(float(shape[name])) < 150 for name in (LEAN, TILT) if name in shape)


def test_equations_without_a_solution_cost_the_shapes_alone(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def singular(*_: object) -> None:
        raise np.linalg.LinAlgError("Singular matrix")

    monkeypatch.setattr("savmap_shelves.inspection.shapes._solved", singular)
    tracks, path = parts(Bent({"upright 2": 8.0}))
    assert straightened(tracks, FACTS, path) == tracks
    assert with_shapes(structures(), tracks, FACTS, path, {})[0].attributes == structures()[0].attributes
    assert "row A: shapes of uprights and beams are not measured: Singular matrix" in caplog.messages


def test_frames_whose_pose_is_wrong_lean_nothing() -> None:
    tracks, path = parts(Bent())
    wrong = path.world_from_rig.copy()
    wrong[:4, 1, 3] += np.linspace(4.0, 1.0, 4)
    tops = [ends_of(k, 0.0, path) for k in (2, 3)]
    straight = straightened([*tops, *tracks], FACTS, replace(path, world_from_rig=wrong))
    assert all(new is old for new, old in zip(straight, [*tops, *tracks], strict=True))
