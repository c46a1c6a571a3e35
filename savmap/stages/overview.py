"""A picture of the chosen views, for the user to check them."""

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from savmap.stages.render import Renderer
from savmap.types import Panorama, ViewSpec

TILE_WIDTH = 480


def overview(
    panoramas: Sequence[Panorama], specs: Sequence[ViewSpec], renderer: Renderer, columns: int = 3
) -> NDArray[np.uint8]:
    """RGB picture: a row of tiles a view, evenly chosen panoramas side by side, each with its angles and time."""
    chosen = [
        panoramas[i] for i in np.linspace(0, len(panoramas) - 1, min(columns, len(panoramas))).round().astype(int)
    ]
    tallest = max(round(TILE_WIDTH * spec.height / spec.width) for spec in specs)
    rows = [np.hstack([_tile(panorama, spec, renderer, tallest) for panorama in chosen]) for spec in specs]
    return np.vstack(rows)


def _tile(panorama: Panorama, spec: ViewSpec, renderer: Renderer, height: int) -> NDArray[np.uint8]:
    image = renderer.render(panorama, spec).image
    scaled = cv2.resize(image, (TILE_WIDTH, round(TILE_WIDTH * spec.height / spec.width)), interpolation=cv2.INTER_AREA)
    tile = np.zeros((height, TILE_WIDTH, 3), np.uint8)
    tile[: len(scaled)] = scaled
    angles = f"yaw {spec.yaw_deg:.1f}  pitch {spec.pitch_deg:.1f}  roll {spec.roll_deg:.1f}  fov {spec.hfov_deg:.0f}"
    tile[:48] //= 3
    for line, text in enumerate((f"{spec.name}  {panorama.stamp_s:.2f} s", angles)):
        cv2.putText(tile, text, (8, 20 + 20 * line), cv2.FONT_HERSHEY_SIMPLEX, 0.5, (255, 255, 255), 1, cv2.LINE_AA)
    return tile
