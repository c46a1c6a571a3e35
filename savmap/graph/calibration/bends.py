"""How pictures are bent at the seam of two lenses that stand apart.

The lenses stand 2 to 3 cm apart, back to back, and what one of them sees does not fit beside what the other sees. A camera's program hides the step: it bends the
pictures about the seam, so that each thing there is displaced by an angle that depends on its distance.
"""

from dataclasses import dataclass

import numpy as np

from savmap.types import Floats


@dataclass(frozen=True)
class Bend:
    """A way to bend the pictures: the front lens's axis is level, turned by `turn_deg` to the right of the drive, and within `wide_deg` on either side of the seam what is
    seen goes over from where one lens stands to where the other does. These stand apart along that axis or, `upwards`, along the vertical, usually by `usual_m`."""

    name: str
    turn_deg: float
    wide_deg: float
    upwards: bool = False
    usual_m: float = 0.0

    def apart(self, drive: Floats) -> Floats:
        """The unit direction (3,) from the rear lens to the front one in the rig frame, by `drive_axes` (3, 3)."""
        return np.asarray(drive[2] if self.upwards else self._axis(drive))

    def _axis(self, drive: Floats) -> Floats:
        turn = np.radians(self.turn_deg)
        return np.asarray(np.cos(turn) * drive[0] + np.sin(turn) * drive[1])

    def displacements(self, rays: Floats, drive: Floats) -> Floats:
        """From where (n, 3) in the rig frame what is along unit rays (n, 3) is seen, for lenses that stand a metre apart."""
        from_seam = np.degrees(np.arcsin(np.clip(rays @ self._axis(drive), -1.0, 1.0)))
        share = np.clip(from_seam / self.wide_deg, -1.0, 1.0) / 2
        return np.asarray(share[:, None] * self.apart(drive))


BENDS = (
    Bend("wide bend", 0.0, 20.0, usual_m=0.0125),
    Bend("narrow bend", 0.0, 5.0, usual_m=0.0125),
    Bend("upwards", 0.0, 10.0, upwards=True),
    Bend("seam turned right", 50.0, 10.0),
    Bend("seam turned left", -50.0, 10.0),
)
"""Where a seam crosses a face beside the drive; one in between is bent like a mixture of these."""


def drive_axes(poses: Floats, speeds: Floats) -> Floats:
    """The unit directions (3, 3) along which a camera mostly goes, across that to the right, and upwards, in the rig frame, from its poses world_from_rig (f, 4, 4), y up,
    and speeds (f, 3) m/s in the world. That along the drive may point backwards; that across it points to the left then."""
    inside = np.einsum("fji,fj->fi", poses[:, :3, :3], speeds)
    along = np.linalg.eigh(inside.T @ inside)[1][:, -1]
    along *= np.sign(along[np.abs(along).argmax()])
    up = poses[:, 1, :3].mean(axis=0)
    up -= (up @ along) * along
    up /= np.maximum(np.linalg.norm(up), 1e-9)
    return np.stack([along, np.cross(along, up), up])
