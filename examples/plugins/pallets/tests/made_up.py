"""Pallets as a camera would see them: poses, views, and masks drawn from the pallets' true corners."""

import cv2
import numpy as np

from savmap.geometry.pinhole import angles_from_rotation, project, rig_from_view
from savmap.types import Detection, Floats, FrameTable, RowFacts, Trajectory, View, ViewSpec
from savmap.vision.view_planning import LEVEL
from savmap_pallets.aim import PITCH_DEG
from savmap_pallets.outline import corners

SIZE = np.array([1.2, 0.144, 0.8])
PALLETS = np.array([[1.0, -0.7, 0.0], [2.7, -0.9, np.radians(37)], [4.6, -0.8, np.radians(118)]])
FRAMES = 12


def spec() -> ViewSpec:
    """The view of the floor of a rig whose panorama's centre looks at the face."""
    return ViewSpec("pass 1 / floor", *angles_from_rotation(rig_from_view(0.0, PITCH_DEG, 0.0)), hfov_deg=110.0)


def path(count: int = FRAMES) -> Trajectory:
    """A drive along x with a little sway: world_from_rig (n, 4, 4)."""
    poses = np.tile(np.eye(4), (count, 1, 1))
    for frame, share in enumerate(np.linspace(0, 1, count)):
        poses[frame, :3, :3] = LEVEL @ rig_from_view(3 * np.sin(9 * share), np.cos(7 * share), np.sin(5 * share))
        poses[frame, :3, 3] = -0.5 + 6.5 * share, 2.5, 2.1 + 0.05 * np.sin(6 * share)
    return Trajectory(np.arange(count), poses)


def facts(count: int = FRAMES) -> RowFacts:
    """The row's facts."""
    view = spec()
    return RowFacts("A", FrameTable(np.arange(count) / 6.0, ("pass 1",) * count), {view.name: view}, {"pass 1": 1})


def view(frame: int) -> View:
    """A view without a picture."""
    own = spec()
    return View(own, frame, frame / 6.0, np.zeros((own.height, own.width, 3), np.uint8))


def pixels(pose: Floats, world_from_rig: Floats) -> Floats:
    """The corners (8, 2) of a pallet in the view, px; NaN behind it."""
    rig = (corners(pose, SIZE) - world_from_rig[:3, 3]) @ world_from_rig[:3, :3]
    return project(rig @ spec().rig_from_view, spec().camera)


def detections(world_from_rig: Floats, pallets: Floats = PALLETS) -> list[Detection]:
    """The masks of pallets in the view of one frame, edges a pixel wide."""
    own = spec()
    found = []
    for pose in pallets:
        seen = pixels(pose, world_from_rig)
        if np.isnan(seen).any():
            continue
        large = np.zeros((8 * own.height, 8 * own.width), np.uint8)
        hull = cv2.convexHull(((seen + 0.5) * 8 - 0.5).astype(np.float32))
        cv2.fillConvexPoly(large, np.round(hull).astype(np.int32), 255)
        probability = (
            np.asarray(cv2.resize(large, (own.width, own.height), interpolation=cv2.INTER_AREA), np.float32) / 255
        )
        mask = probability > 0.5
        if mask.sum() > 20:
            found.append(Detection("pallet", 0.9, mask, probability))
    return found
