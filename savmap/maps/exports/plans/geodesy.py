"""Places of the world on the Earth (WGS 84), by the anchor: the world's plane touches the ellipsoid there, x to the
east, y to the north."""

import numpy as np

from savmap.errors import OutputError
from savmap.types import Floats, SiteMap

SEMI_MAJOR_M, FLATTENING = 6_378_137.0, 1 / 298.257223563
ECCENTRICITY2 = FLATTENING * (2 - FLATTENING)
FARTHEST_M = 20_000.0
"""Further from the anchor, the plane is metres above the Earth: the anchor is then not that of the world's origin."""
DECIMALS = 9
"""Of degrees: 0.1 mm."""
ROUNDS = 5


class Earth:
    """The Earth at a site's anchor. Raises OutputError for a site without one."""

    def __init__(self, site: SiteMap) -> None:
        if site.alignment is None or site.alignment.anchor is None:
            raise OutputError(
                "this format needs latitude and longitude: give `align:` with an `anchor:` in the site file, or to `savmap align`"
            )
        self.latitude, self.longitude = site.alignment.anchor

    def positions(self, places: Floats) -> list[list[float]]:
        """Longitude and latitude in degrees (n, 2), in GeoJSON's order, of places (n, 2) m of the world. Raises
        OutputError for places far from the anchor."""
        away = float(np.linalg.norm(places, axis=1).max(initial=0.0))
        if away > FARTHEST_M:
            raise OutputError(
                f"the site is {away / 1000:.0f} km from the `anchor:`, which is where the origin of your world is on the Earth"
            )
        turned = self._east_north_up() @ np.column_stack([places, np.zeros(len(places))]).T
        x, y, z = turned + _centred(np.radians(self.latitude), np.radians(self.longitude))[:, None]
        across = np.hypot(x, y)
        latitude = np.arctan2(z, across * (1 - ECCENTRICITY2))
        for _ in range(ROUNDS):
            latitude = np.arctan2(z + ECCENTRICITY2 * _normal(latitude) * np.sin(latitude), across)
        degrees = np.degrees(np.column_stack([np.arctan2(y, x), latitude]))
        rounded: list[list[float]] = (np.round(degrees, DECIMALS) + 0.0).tolist()
        return rounded

    def _east_north_up(self) -> Floats:
        """Rotation (3, 3) from east, north, up at the anchor to the Earth's axes."""
        latitude, longitude = np.radians(self.latitude), np.radians(self.longitude)
        sin, cos = np.sin(latitude), np.cos(latitude)
        east = [-np.sin(longitude), np.cos(longitude), 0.0]
        north = [-sin * np.cos(longitude), -sin * np.sin(longitude), cos]
        up = [cos * np.cos(longitude), cos * np.sin(longitude), sin]
        return np.array([east, north, up]).T


def _normal(latitude: Floats | float) -> Floats:
    radius: Floats = SEMI_MAJOR_M / np.sqrt(1 - ECCENTRICITY2 * np.sin(latitude) ** 2)
    return radius


def _centred(latitude: float, longitude: float) -> Floats:
    """The place (3,) m of the ellipsoid in the Earth's axes."""
    radius = _normal(latitude)
    x, y = radius * np.cos(latitude) * np.cos(longitude), radius * np.cos(latitude) * np.sin(longitude)
    return np.array([x, y, radius * (1 - ECCENTRICITY2) * np.sin(latitude)])
