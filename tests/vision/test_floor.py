"""Where the floor is: what shows on it tells, and when it tells nothing."""

from collections.abc import Callable

import cv2
import numpy as np
import pytest

from savmap.geometry import pinhole
from savmap.types import Floats, PlanePatch, Trajectory, ViewSpec
from savmap.vision.evidence import FloorHeight, FloorTracks, PackedView, floor_height, floor_tracks
from savmap.vision.evidence.floor import Floor

HEIGHT_M, AWAY_M, LENGTH_M = 1.9, 1.6, 7.0
CELL_M = 0.005
SPEC = ViewSpec("floor", 0.0, pitch_deg=-50.0, hfov_deg=110.0)
XS = np.linspace(0.0, LENGTH_M, 29)
AT_FACE = np.diag([1.0, -1.0, -1.0])
"""The rig looks at the face: x right, y down, z forward is the row's x, -y, -z."""


def poses() -> Floats:
    matrices = np.tile(np.eye(4), (len(XS), 1, 1))
    matrices[:, :3, :3] = AT_FACE
    matrices[:, :3, 3] = np.stack([XS, np.full_like(XS, HEIGHT_M), np.full_like(XS, AWAY_M)], axis=1)
    return matrices


def stains(rng: np.random.Generator, contrast: float) -> Floats:
    """A floor with soft stains of a few grey levels, from x = -3 m and z = -1 m on."""
    size = (round(2.5 / CELL_M), round((LENGTH_M + 6) / CELL_M))
    fine = cv2.GaussianBlur(rng.normal(0, 1, size), (0, 0), 5)
    return np.asarray(120 + contrast * fine / fine.std(), np.float64)


def packed_views_of(
    floor: Callable[[Floats, Floats], Floats], noise: float = 1.0, mirrored: Floats | None = None
) -> list[PackedView]:
    """Packed views of a floor whose brightness at (x, z) is known, seen through the view's pixels, and the face, `mirrored` in it."""
    rng, packed_views = np.random.default_rng(7), []
    columns, rows = np.meshgrid(np.arange(SPEC.width), np.arange(SPEC.height))
    rays = pinhole.rays_from_pixels(np.stack([columns, rows], axis=-1), SPEC.camera) @ SPEC.rig_from_view.T @ AT_FACE
    for frame, pose in enumerate(poses()):
        down = np.minimum(rays[..., 1], -1e-3)
        hit = pose[:3, 3] + rays * (-pose[1, 3] / down)[..., None]
        image = np.where(rays[..., 1] < -1e-2, floor(hit[..., 0], hit[..., 2]), 0.0)
        if mirrored is not None:
            below = pose[:3, 3] - rays * (pose[2, 3] / np.minimum(rays[..., 2], -1e-3))[..., None]
            shown = (below[..., 1] < 0) & (below[..., 1] > -2.0) & (hit[..., 2] > 0)
            image += np.where(shown, sampled(mirrored, below[..., 0], -1.0 - below[..., 1]) - 120, 0.0)
        image = np.clip(image + rng.normal(0, noise, image.shape), 0, 255).astype(np.uint8)
        packed_views.append(
            PackedView(frame, SPEC.name, (), bytes(cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, 92])[1]))
        )
    return packed_views


def sampled(texture: Floats, x: Floats, z: Floats) -> Floats:
    """A texture at places."""
    along, across = (((value + room) / CELL_M).astype(np.float32) for value, room in ((x, 3.0), (z, 1.0)))
    return np.asarray(cv2.remap(texture.astype(np.float32), along, across, cv2.INTER_LINEAR), np.float64)


def at_level(texture: Floats, level: float) -> Callable[[Floats, Floats], Floats]:
    """What a camera sees of a texture that lies at a level, at the places where its rays meet y = 0."""

    def seen(x: Floats, z: Floats) -> Floats:
        camera = XS[np.abs(XS - np.median(x)).argmin()]
        near = (HEIGHT_M - level) / HEIGHT_M
        across, along = AWAY_M + near * (z - AWAY_M), camera + near * (x - camera)
        return sampled(texture, along, across)

    return seen


def measured(packed_views: list[PackedView], scale: float = 1.0, zero: float = 0.0) -> FloorTracks:
    """The floor by a path in units of 1 / scale m whose zero is so far above the floor."""
    matrices = poses()
    matrices[:, :3, 3] = scale * (matrices[:, :3, 3] - [0.0, zero, 0.0])
    size = scale * np.array([LENGTH_M, 4.0])
    face = PlanePatch("face", scale * np.array([0.0, 0.2 - zero, 0.0]), *np.eye(3)[:2], size, 0.01)
    seen = face, packed_views, {SPEC.name: SPEC}, Trajectory(np.arange(len(XS)), matrices)
    height = floor_height(*seen)
    return floor_tracks(*seen, height) if height else FloorTracks()


def heights(found: FloorTracks) -> Floats:
    """The floor's y at each point, m, by its pixels and the true poses."""
    values = []
    for track in found.tracks:
        forms, values_of = [], []
        for frame, pixel in zip(track.frames, track.pixels, strict=True):
            pose = poses()[frame]
            ray = pose[:3, :3] @ SPEC.rig_rays(pixel)
            across = np.eye(3) - np.outer(ray, ray)
            forms.append(across)
            values_of.append(across @ pose[:3, 3])
        values.append(np.linalg.lstsq(np.concatenate(forms), np.concatenate(values_of), rcond=None)[0][1])
    return np.array(values)


def test_faint_stains_tell_where_the_floor_is() -> None:
    """The path's scale and zero are of no matter: guards hide the feet of all uprights."""
    packed_views = packed_views_of(at_level(stains(np.random.default_rng(1), 1.5), 0.0), noise=1.5)
    found = measured(packed_views, scale=0.7, zero=0.35)
    assert len(found.tracks) >= 8
    assert heights(found) == pytest.approx(0.0, abs=3 * found.sigma * HEIGHT_M)
    assert 0.003 <= found.sigma < 0.006
    assert all(2 <= len(track.frames) <= 3 for track in found.tracks)


@pytest.mark.slow
def test_a_height_that_an_earlier_path_gave_saves_the_coarse_sweep(monkeypatch: pytest.MonkeyPatch) -> None:
    packed_views = packed_views_of(at_level(stains(np.random.default_rng(1), 1.5), 0.0), noise=1.5)
    face = PlanePatch("face", np.array([0.0, 0.2, 0.0]), *np.eye(3)[:2], np.array([LENGTH_M, 4.0]), 0.01)
    seen = face, packed_views, {SPEC.name: SPEC}, Trajectory(np.arange(len(XS)), poses())
    first = floor_height(*seen)
    assert first is not None
    assert first.y == pytest.approx(0.0, abs=3 * first.sigma * HEIGHT_M + 0.002)
    assert floor_height(*seen, about=1.2 * first.share) == first
    monkeypatch.setattr(Floor, "rough_height", lambda floor: pytest.fail("swept coarsely"))
    again = floor_height(*seen, about=1.01 * first.share)
    assert again is not None
    assert again.share == pytest.approx(first.share, rel=0.002)


@pytest.mark.slow
def test_the_face_mirrored_in_the_floor_is_outvoted() -> None:
    """It is upright: every strip of the floor shows it at another depth."""
    floor = at_level(stains(np.random.default_rng(1), 1.5), 0.0)
    found = measured(packed_views_of(floor, mirrored=stains(np.random.default_rng(3), 4.5)))
    assert heights(found) == pytest.approx(0.0, abs=0.004)
    assert not measured(
        packed_views_of(lambda x, z: np.full_like(x, 120.0), mirrored=stains(np.random.default_rng(3), 4.5))
    ).tracks


def test_a_plain_floor_tells_nothing() -> None:
    assert not measured(packed_views_of(lambda x, z: np.full_like(x, 120.0), noise=3.0)).tracks


def test_markings_along_the_aisle_tell_nothing() -> None:
    """They are the same in all frames, whatever the height."""
    assert not measured(packed_views_of(lambda x, z: np.where(np.abs(z - 0.9) < 0.05, 180.0, 120.0))).tracks


def test_a_floor_of_two_levels_tells_nothing() -> None:
    texture = stains(np.random.default_rng(2), 4.0)
    low, high = at_level(texture, 0.0), at_level(texture, 0.12)
    found = measured(packed_views_of(lambda x, z: np.where(z < 0.75, high(x, z), low(x, z))))
    assert not found.tracks


def test_pictures_of_unknown_place_tell_nothing() -> None:
    face = PlanePatch("face", np.zeros(3), *np.eye(3)[:2], np.ones(2), 0.01)
    packed_view = PackedView(99, SPEC.name, (), b"")
    seen = face, [packed_view], {SPEC.name: SPEC}, Trajectory(np.arange(len(XS)), poses())
    assert floor_height(*seen) is None
    assert not floor_tracks(*seen, FloorHeight(0.0, 1.0, 0.01)).tracks
