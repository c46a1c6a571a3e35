"""Pictures of the views that the aim chooses, one a pass."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from savmap.files.atomic import file_name, write_bytes
from savmap.pipeline.view_plans import PassPlan, looked_at, plan_shown
from savmap.plugin.manager import LoadedPlugin
from savmap.site.model import Pass, pass_names
from savmap.types import Floats, Panorama, ViewSpec
from savmap.vision.view_planning import PassPreview
from savmap.vision.views import Renderer

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


def previews(
    row: str, passes: Sequence[Pass], plugins: Sequence[LoadedPlugin], folder: Path, attitudes: Mapping[str, Floats]
) -> Iterator[Path]:
    """Write a picture of the chosen views of each pass of a row over its key frames; gives the paths written.
    `attitudes`: world_from_rig (3, 3) at the start of a pass where an earlier map gives it."""
    for name, row_pass in zip(pass_names(passes), passes, strict=True):
        yield write_views(row, folder, *planned(name, row_pass, plugins, attitudes.get(name)))


def planned(
    name: str, row_pass: Pass, plugins: Sequence[LoadedPlugin], attitude: Floats | None
) -> tuple[PassPlan, PassPreview]:
    """How a run looks at a pass, and the pictures by which that was chosen. Raises SavmapError's kinds."""
    row_pass, shown, walk = looked_at(row_pass, Renderer())
    return plan_shown(name, row_pass, plugins, shown, attitude, walk), shown


def write_views(row: str, folder: Path, plan: PassPlan, shown: PassPreview) -> Path:
    """Write a picture of the views of a pass over its key frames: "views-A-pass-1.jpg"."""
    picture = overview(shown.keys, list(dict.fromkeys(plan.views().values())), shown.renderer)
    path = folder / f"views-{file_name(row)}-{plan.name.replace(' ', '-')}.jpg"
    write_bytes(path, cv2.imencode(".jpg", picture[..., ::-1])[1].tobytes())
    return path
