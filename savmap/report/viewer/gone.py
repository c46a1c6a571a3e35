"""Where a row that only an earlier map has stands on the new map's site."""

import numpy as np

from savmap.report.viewer.dates import Before
from savmap.types import Floats, Placement, SiteMap


def old_place(before: Before, site_map: SiteMap, name: str) -> Placement | None:
    """Of a row of the earlier map: carried as the nearest row is that has its place on both dates. None where none has,
    or the row itself has no place. `covariance` is the earlier map's: how well the dates' sites lie on one another is
    not in it."""
    places = before.site_map.placements
    own = places.get(name)
    both = [
        row
        for row in before.comparison.rows
        if row.motion and row.old in places and row.new in site_map.placements and not row.motion.ambiguous
    ]
    if own is None or not both:
        return None
    nearest = min(both, key=lambda row: _apart(own, places[row.old]))
    assert nearest.motion is not None
    old, new = places[nearest.old], site_map.placements[nearest.new]
    # the frame's origin and a point on its x axis, seen from the nearest row
    ends = own.points(np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]]))
    in_nearest = (ends - old.site_from_row[:3, 3]) @ old.site_from_row[:3, :3]
    begin, end = new.points(nearest.motion.points(in_nearest))
    along: Floats = end - begin
    heading = float(np.degrees(np.arctan2(-along[2], along[0])))
    return Placement(float(begin[0]), float(begin[2]), heading, own.covariance)


def _apart(one: Placement, other: Placement) -> float:
    return float(np.hypot(one.x_m - other.x_m, one.z_m - other.z_m))
