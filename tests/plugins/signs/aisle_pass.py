"""Features of signs, without pictures, for a camera that drives past a face and under signs across the aisle."""

from collections.abc import Iterator, Sequence

import numpy as np

from savmap.geometry.pinhole import project
from savmap.types import Feature, Floats, FrameTable, RowFacts, Structure, Trajectory, ViewSpec
from savmap_signs.features import PARTS
from savmap_signs.lab.scene import Plate, corners

LEVEL = np.diag([1.0, -1.0, -1.0])
VIEWS = {
    "pass 1 / signs lower": ViewSpec("pass 1 / signs lower", 0.0, -25.0, hfov_deg=90.0),
    "pass 1 / signs ahead": ViewSpec("pass 1 / signs ahead", 90.0, 10.0, hfov_deg=90.0),
}
PLATES = (
    Plate(at=(1.0, 1.8, 0.0), text="A21-01"),
    Plate(at=(3.7, 1.8, 0.0), text="A21-02"),
    Plate(at=(5.0, 3.3, 1.3), size=(0.8, 0.4), text="AISLE A", facing="-x"),
)
TRUTH = [corners(plate, plate.facing) for plate in PLATES]  # type: ignore[arg-type]


def drive(count: int = 16) -> tuple[RowFacts, Trajectory]:
    """A row of `count` frames along x, looking at the face."""
    poses = np.tile(np.eye(4), (count, 1, 1))
    poses[:, :3, :3] = LEVEL
    poses[:, :3, 3] = np.column_stack([np.linspace(-0.5, 4.6, count), np.full(count, 2.4), np.full(count, 1.4)])
    table = FrameTable(np.arange(count) / 3, ("pass 1",) * count)
    return RowFacts("A", table, VIEWS, {"pass 1": 1}), Trajectory(np.arange(count), poses)


def sign_features(path: Trajectory, signs: Sequence[Floats], noise_px: float = 0.3) -> list[Feature]:
    """Features of all signs in all frames that show them whole, from the front."""
    rng = np.random.default_rng(1)
    return [
        feature
        for frame, pose in zip(path.frames.tolist(), path.world_from_rig, strict=True)
        for spec in VIEWS.values()
        for number, sign in enumerate(signs)
        for feature in _features(frame, spec, pose, number, sign, rng.normal(0, noise_px, (4, 2)))
    ]


def _features(frame: int, spec: ViewSpec, pose: Floats, number: int, sign: Floats, noise: Floats) -> Iterator[Feature]:
    away = sign - pose[:3, 3]
    normal = np.cross(sign[3] - sign[0], sign[1] - sign[0])
    pixels = project(away @ pose[:3, :3] @ spec.rig_from_view, spec.camera)
    inside = np.isfinite(pixels).all() and pixels.min() > 3 and (pixels < [spec.width - 4, spec.height - 4]).all()
    if inside and normal @ away.mean(axis=0) < 0 and np.ptp(pixels, axis=0).min() > 6:
        readings = {f"text:{PLATES[number % len(PLATES)].text}": 0.95}
        for index, part in enumerate(PARTS):
            pixel = (pixels + noise)[index][None]
            first = readings if index == 0 else {}
            yield Feature(frame, spec.name, "sign", part, number, pixel, 0.1 * np.eye(2)[None], readings=first)


def structure(name: str, vertices: Floats, **attributes: float | int | str) -> Structure:
    """A mapped structure "sign 1" with these vertices (n, 3) m."""
    count = len(vertices)
    covariances = np.tile(1e-6 * np.eye(3), (count, 1, 1))
    edges = np.zeros((0, 2), int)
    return Structure(name, name.split()[0], vertices, covariances, ("",) * count, edges, attributes)
