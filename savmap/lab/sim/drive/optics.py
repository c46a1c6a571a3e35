"""What consumer cameras do to panoramas: halves of two lenses that do not quite fit, rows read out one after the
other."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation, Slerp

from savmap.geometry.pinhole import project
from savmap.lab.scenes import RowFrame
from savmap.lab.sim.drive.cart import Drive
from savmap.types import Floats, ViewSpec

_SAMPLES = 65
_LEAST_PX = 12.0
_NEIGHBOURS = 2
_ROUNDS = 2


@dataclass(frozen=True)
class Optics:
    """The rear half's turn against the front half, degrees, about the rig's x, y and z (pitch, yaw, roll); by what part
    true angles from the lens's axis are larger than they seem, front and rear; seconds from the top row to the bottom
    row."""

    turn_deg: tuple[float, float, float] = (0.0, 0.0, 0.0)
    scales: tuple[float, float] = (0.0, 0.0)
    read_out_s: float = 0.0

    def seen(self, rays: Floats) -> Floats:
        """Where true unit rays (n, 3) of the rig seem to come from; the seam is where the lenses meet."""
        half = Rotation.from_rotvec(np.radians(self.turn_deg) / 2)
        front = _shrunk(half.apply(rays), 1.0, self.scales[0])
        rear = _shrunk(half.inv().apply(rays), -1.0, self.scales[1])
        seen: Floats = np.where(rays[:, 2:] > 0, front, rear)
        return seen


def _shrunk(rays: Floats, side: float, scale: float) -> Floats:
    """Rays (n, 3) as a lens along +z or -z (`side`) shows them."""
    off_axis = np.arccos(np.clip(side * rays[:, 2], -1.0, 1.0))
    radius = np.maximum(np.hypot(rays[:, 0], rays[:, 1]), 1e-12)
    seems = off_axis / (1 + scale)
    sideways = (np.sin(seems) / radius)[:, None] * rays[:, :2]
    return np.concatenate([sideways, side * np.cos(seems)[:, None]], axis=1)


def seen_edges(
    edges: Floats, frame: RowFrame, path: Drive, index: int, spec: ViewSpec, optics: Optics
) -> list[Floats | None]:
    """For each pair of edges (k, 2, 2, 3) m of a row, the ends' pixels (2, 2, 2) of the straight lines that fit best to
    what a view shows of them; None where either hardly shows."""
    share = np.linspace(0, 1, _SAMPLES)[:, None]
    points = edges[:, :, :1] + share * (edges[:, :, 1:] - edges[:, :, :1])
    rays = _at_read_out(frame.to_world(points.reshape(-1, 3)), path, index, optics)
    pixels = project(optics.seen(rays) @ spec.rig_from_view, spec.camera)
    size = np.array([spec.width, spec.height]) - 0.5
    inside = (pixels[:, 0] > -0.5) & (pixels[:, 1] > -0.5) & (pixels[:, 0] < size[0]) & (pixels[:, 1] < size[1])
    shape = points.shape[:3]
    pairs = zip(pixels.reshape(*shape, 2), inside.reshape(shape), strict=True)
    return [_lines(edges_px, shown) for edges_px, shown in pairs]


def _lines(pixels: Floats, shown: NDArray[np.bool_]) -> Floats | None:
    """Two lines' ends (2, 2, 2) from their pixels (2, n, 2)."""
    if shown.sum(axis=1).min() < 2:
        return None
    lines = np.array([_line(edge[inside]) for edge, inside in zip(pixels, shown, strict=True)])
    return lines if np.linalg.norm(lines[:, 1] - lines[:, 0], axis=1).min() > _LEAST_PX else None


def _at_read_out(points: Floats, path: Drive, index: int, optics: Optics) -> Floats:
    """Unit rays (n, 3) of the rig to points (n, 3) m, each from where the camera is when its row is read out."""
    near = slice(max(index - _NEIGHBOURS, 0), index + _NEIGHBOURS + 1)
    close = Drive(path.stamps_s[near], path.origins[near], path.world_from_rig[near])
    times = np.full(len(points), path.stamps_s[index])
    rays = _rays(points, close, times)
    for _ in range(_ROUNDS if optics.read_out_s else 0):
        late = optics.read_out_s * np.arcsin(np.clip(rays[:, 1], -1.0, 1.0)) / np.pi
        rays = _rays(points, close, times + late)
    return rays


def _rays(points: Floats, path: Drive, times: Floats) -> Floats:
    """Unit rays (n, 3) of the rig to points (n, 3) m at times (n,); the camera stands before the path and after it."""
    times = np.clip(times, path.stamps_s[0], path.stamps_s[-1])
    origins = np.stack([np.interp(times, path.stamps_s, column) for column in path.origins.T], axis=1)
    turns = Slerp(path.stamps_s, Rotation.from_matrix(path.world_from_rig))(times)
    offsets = turns.inv().apply(points - origins)
    rays: Floats = offsets / np.linalg.norm(offsets, axis=1, keepdims=True)
    return rays


def _line(pixels: Floats) -> Floats:
    """Ends (2, 2) of the straight line through pixels (n, 2), as long as these."""
    middle = pixels.mean(axis=0)
    along = np.linalg.svd(pixels - middle, full_matrices=False)[2][0]
    reach = (pixels - middle) @ along
    if (pixels[-1] - pixels[0]) @ along < 0:
        reach = reach[::-1]
    ends: Floats = middle + reach[[0, -1], None] * along
    return ends
