"""The path of a drive, and the orthophoto of an upright plane beside it that the user names: no plugin, no network."""

from dataclasses import dataclass, replace
from importlib.metadata import version
from pathlib import Path

import numpy as np

from savmap.errors import StructureError
from savmap.files.atomic import write_bytes
from savmap.files.journal import Journal
from savmap.geometry.poses import middle_rotation
from savmap.graph import References
from savmap.maps.map_file import write_map
from savmap.pipeline.drive import RowWalk, drive_along
from savmap.pipeline.records import RowRequest
from savmap.pipeline.trust.footage import require_panoramas
from savmap.pipeline.view_plans import PassPlan, looked_at
from savmap.plugin.segmenters import SegmenterPool
from savmap.site.job import prepare
from savmap.site.model import Pass, Side
from savmap.types import (
    MapWarning,
    Orthophoto,
    PlanePatch,
    RowMap,
    SiteMap,
    Trajectory,
    Verdict,
    ViewPlan,
)
from savmap.types.progress import Monitor
from savmap.vision.orthophoto import orthophoto
from savmap.vision.view_planning import choose_face, tilted
from savmap.vision.views import Renderer

ROW, VIEW, HFOV_DEG = "1", "plane", 130.0
STEEPEST = float(np.tan(np.radians(50.0)))
"""Of the part of the plane that is shown, seen from the path."""
CELL_M = 0.02


@dataclass(frozen=True, eq=False)
class BesideDrive:
    """A map of the path alone, and the plane's orthophoto; None where no picture shows it."""

    site_map: SiteMap
    photo: Orthophoto | None

    @property
    def path(self) -> Trajectory:
        """The path, m."""
        return self.site_map.rows[ROW].trajectory

    @property
    def length_m(self) -> float:
        """How long the path is."""
        return float(np.linalg.norm(np.diff(self.path.world_from_rig[:, :3, 3], axis=0), axis=1).sum())


def map_plane(video: Path, side: Side, distance_m: float, output: Path, monitor: Monitor) -> BesideDrive:
    """Write map.json, which has the path alone, and plane.jpg into a folder. The plane is upright, and runs with the
    building; `distance_m` is how far from it the camera goes, which gives the scale: it holds where most of what is
    seen on that side lies in the plane.

    Raises VideoError where the video cannot be read, StructureError where it tells no path, OutputError.
    """
    prepare(output)
    result = beside_drive(Pass(video=video, side=side), distance_m, monitor)
    if result.photo is not None:
        write_bytes(output / "plane.jpg", result.photo.picture.tobytes())
    write_map(result.site_map, output / "map.json")
    return result


def beside_drive(row_pass: Pass, distance_m: float, monitor: Monitor) -> BesideDrive:
    """The path of a pass, and the plane on its side. Raises as `map_plane` does."""
    renderer = Renderer()
    row_pass, preview, lens_walk = looked_at(row_pass, renderer)
    warnings = require_panoramas(row_pass.clip, preview.keys)
    face = choose_face(preview, lambda spec, panorama: 1.0, row_pass.side)
    views = ViewPlan((tilted(face, 0.0, HFOV_DEG, VIEW),), face.world_from_rig, face.travel)
    plan = PassPlan("pass 1", row_pass.clip, {VIEW: views}, row_pass.side, warnings, lens_walk)
    request = RowRequest(ROW, (row_pass,), (), References(), strips=True)
    walk = RowWalk((request, plan), SegmenterPool(()), renderer, Journal())
    walk.begin(plan.name, row_pass, monitor)
    drive_along(row_pass.clip, [walk], renderer, monitor)
    if walk.failure is not None:
        raise walk.failure
    row = walk.walked()
    if row.measurements.walked is None:
        raise StructureError(f"{row_pass.clip.path}: too few points can be followed from frame to frame")
    path = _in_metres(row.measurements.walked, walk, distance_m)
    patch = _shown(path, distance_m)
    warning = MapWarning("doubtful-scale", details=("the scale rests on the plane's distance alone",))
    verdict = Verdict((*warnings, *row.measurements.warnings, warning))
    facts = row.measurements.facts
    row_map = RowMap(ROW, facts.frames, facts.views, path, {}, (), face=patch, verdict=verdict)
    return BesideDrive(SiteMap({ROW: row_map}, {"savmap": version("savmap")}), orthophoto(patch, row.strips, path))


def _in_metres(walked: Trajectory, walk: RowWalk, distance_m: float) -> Trajectory:
    """The path before the plane z = 0, with its first place at x = y = 0."""
    poses = walked.world_from_rig.copy()
    attitude = walk.plan.attitude()
    assert attitude is not None
    turn = middle_rotation(attitude @ poses[:, :3, :3].transpose(0, 2, 1))
    poses[:, :3, :3] = turn @ poses[:, :3, :3]
    places = distance_m * poses[:, :3, 3] @ turn.T
    begin = np.array([places[0, 0], places[0, 1], float(np.median(places[:, 2])) - distance_m])
    poses[:, :3, 3] = places - begin
    return replace(walked, world_from_rig=poses)


def _shown(path: Trajectory, distance_m: float) -> PlanePatch:
    """The part of the plane that the path goes past."""
    low, high = path.world_from_rig[:, :3, 3].min(axis=0), path.world_from_rig[:, :3, 3].max(axis=0)
    reach = STEEPEST * distance_m
    origin = np.array([low[0] - distance_m / 2, low[1] - reach, 0.0])
    size = np.array([high[0] - low[0] + distance_m, high[1] - low[1] + 2 * reach])
    return PlanePatch(VIEW, origin, np.eye(3)[0], np.eye(3)[1], size, CELL_M)
