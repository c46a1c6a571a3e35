"""How pictures are bent at the seam of two lenses, by the parallax of their baseline.

The lenses stand 2 to 3 cm apart, back to back, and what one of them sees does not fit beside what the other sees. A
camera's program hides the step: it bends the pictures about the seam, so that each thing there is displaced by an angle
that depends on its distance.
"""

from dataclasses import dataclass

import numpy as np

from savmap.types import Floats


@dataclass(frozen=True)
class Bend:
    """A way to bend the pictures. The front lens looks along a level axis, `turn_deg` to the right of the drive. From
    `half_width_deg` before the seam to as much behind it, the point of view moves from one lens to the other. The
    baseline between them lies along that axis or, `upwards`, along the vertical; the solve begins with `initial_m` of
    it.

    `drive` (3, 3) of its methods are the axes that `drive_axes` gives.
    """

    name: str
    turn_deg: float
    half_width_deg: float
    upwards: bool = False
    initial_m: float = 0.0

    def baseline(self, drive: Floats) -> Floats:
        """The unit direction (3,) from the rear lens to the front one."""
        return np.asarray(drive[2] if self.upwards else self._axis(drive))

    def _axis(self, drive: Floats) -> Floats:
        turn = np.radians(self.turn_deg)
        return np.asarray(np.cos(turn) * drive[0] + np.sin(turn) * drive[1])

    def points_of_view(self, rays: Floats, drive: Floats) -> Floats:
        """From where (n, 3), beside the rig's centre, unit rays (n, 3) are seen, for a baseline of a metre."""
        from_seam = np.degrees(np.arcsin(np.clip(rays @ self._axis(drive), -1.0, 1.0)))
        share = np.clip(from_seam / self.half_width_deg, -1.0, 1.0) / 2
        return np.asarray(share[:, None] * self.baseline(drive))


BENDS = (
    Bend("wide bend", 0.0, 20.0, initial_m=0.0125),
    Bend("narrow bend", 0.0, 5.0, initial_m=0.0125),
    Bend("upwards", 0.0, 10.0, upwards=True),
    Bend("seam turned right", 50.0, 10.0),
    Bend("seam turned left", -50.0, 10.0),
)
"""Where a seam crosses a face beside the drive; one in between is bent like a mixture of these."""


def total_baseline(parts: Floats, covariance: Floats) -> tuple[float, float]:
    """The length of the baseline that is the sum of the bends' `parts` (b,), m, and its standard deviation, by the
    parts' covariance (b, b)."""
    directions = np.array([bend.baseline(np.eye(3)) for bend in BENDS])
    total = parts @ directions
    length = float(np.linalg.norm(total))
    along = directions @ total / max(length, 1e-9)
    return length, float(np.sqrt(max(along @ covariance @ along, 0.0)))


def largest_displacement(parts: Floats) -> float:
    """The farthest, m, that the bends' `parts` (b,) of the baseline move the point of view of any level ray."""
    turns = np.radians(np.arange(360.0))
    rays = np.stack([np.cos(turns), np.sin(turns), np.zeros(len(turns))], axis=1)
    places = np.einsum("b,bni->ni", parts, np.stack([bend.points_of_view(rays, np.eye(3)) for bend in BENDS]))
    return float(np.linalg.norm(places, axis=1).max())


def drive_axes(poses: Floats, speeds: Floats) -> Floats:
    """The unit directions (3, 3) along which a camera mostly goes, across that to the right, and upwards, in the rig
    frame, from its poses world_from_rig (f, 4, 4), y up, and speeds (f, 3) m/s in the world: one for all passes, for
    the camera is one."""
    inside = np.einsum("fji,fj->fi", poses[:, :3, :3], speeds)
    along = np.linalg.eigh(inside.T @ inside)[1][:, -1]
    along *= -1.0 if along @ inside.sum(axis=0) < 0 else 1.0
    up = poses[:, 1, :3].mean(axis=0)
    up -= (up @ along) * along
    up /= np.maximum(np.linalg.norm(up), 1e-9)
    return np.stack([along, np.cross(along, up), up])
