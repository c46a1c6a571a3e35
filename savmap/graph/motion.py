"""How fast cameras move, from their poses in neighbouring frames."""

import numpy as np
from scipy.spatial.transform import Rotation

from savmap.types import Floats


def velocities(poses: Floats, stamps_s: Floats) -> tuple[Floats, Floats]:
    """Speeds (f, 3) m/s in the world and turning rates (f, 3) rad/s in the rig frame of poses (f, 4, 4) at stamps (f,), in
    order of time; zeros where the stamps do not tell."""
    count = len(poses)
    before, after = np.maximum(np.arange(count) - 1, 0), np.minimum(np.arange(count) + 1, count - 1)
    span = stamps_s[after] - stamps_s[before]
    per_second = np.where(span > 0, 1 / np.where(span > 0, span, 1.0), 0.0)[:, None]
    turned = np.swapaxes(poses[before, :3, :3], 1, 2) @ poses[after, :3, :3]
    rates: Floats = Rotation.from_matrix(turned).as_rotvec() * per_second
    return (poses[after, :3, 3] - poses[before, :3, 3]) * per_second, rates
