"""Footage with the wireframe over it, at the places of a row where its map is most likely wrong: what a person looks at who has no survey."""

import base64
from collections.abc import Iterator, Sequence

import cv2
import numpy as np

from savmap.geometry import pinhole
from savmap.report.numbers import centimetres
from savmap.report.scene import Backdrop, Figure, Label, Layer, Shape, path
from savmap.types import Floats, Panorama, RowMap, Score, Still, Structure, ViewSpec
from savmap.vision.views import Renderer

WIDTH, HEIGHT, HFOV_DEG = 720, 480, 80.0
JPEG_QUALITY = 70
MOST = 2
"""Of a row with doubts; others have one."""
NEAR_M = 0.1
"""Lines nearer to the camera are cut there."""
MAPPED, WORST = "mapped structure polygon photo", "off structure polygon photo"


def footage_views(row: RowMap, stills: Sequence[Still], score: Score | None, anchor: str) -> Iterator[Figure]:
    """Pictures of the worst places, each from the still that was taken nearest to it; none where no stills were kept."""
    poses = dict(zip(row.trajectory.frames.tolist(), row.trajectory.world_from_rig, strict=True))
    placed = [still for still in stills if still.frame in poses]
    for number, (structure, why) in enumerate(_worst(row, score) if placed else (), 1):
        target = structure.vertices.mean(axis=0)
        still = min(placed, key=lambda one: float(np.linalg.norm(poses[one.frame][:3, 3] - target)))
        yield _figure(row, structure, why, still, poses[still.frame], f"{anchor}-footage-{number}")


def _worst(row: RowMap, score: Score | None) -> list[tuple[Structure, str]]:
    """Structures that deserve a look, and why: those that doubts name; else the one furthest off the survey; else the one that the fewest
    of the frames show that should."""
    by_id = {
        structure.id: structure for group in row.structures.values() for structure in group if len(structure.edges)
    }
    doubts = row.verdict.doubts if row.verdict else ()
    named = {name: f"{doubt.kind}: {doubt.what}" for doubt in doubts for name in doubt.structures if name in by_id}
    if named:
        return [(by_id[name], why) for name, why in list(named.items())[:MOST]]
    off = {name: size for name, size in (score.deviations if score else {}).items() if name in by_id}
    if off:
        furthest = max(off, key=lambda name: off[name])
        far = f"{centimetres(off[furthest])} cm" if np.isfinite(off[furthest]) else "not in it at all"
        return [(by_id[furthest], f"the furthest off the survey: {far}")]
    seen = {
        name: one.attributes["support"]
        for name, one in by_id.items()
        if isinstance(one.attributes.get("support"), float)
    }
    if not seen:
        return []
    least = min(seen, key=lambda name: seen[name])
    return [(by_id[least], f"seen by the fewest of the frames that should show it: {100 * seen[least]:.0f} %")]


def _figure(row: RowMap, structure: Structure, why: str, still: Still, pose: Floats, name: str) -> Figure:
    spec = aimed(pose, structure.vertices.mean(axis=0))
    frame = (0, 0, WIDTH, HEIGHT)
    others = [one for group in row.structures.values() for one in group if one is not structure]
    lines = [_lines(one, spec, pose) for one in others]
    layers = [
        Layer(MAPPED, tuple(Shape(line, one.id) for one, line in zip(others, lines, strict=True) if line)),
        Layer(WORST, (Shape(_lines(structure, spec, pose), structure.id),)),
    ]
    stamp = float(row.frames.stamps_s[still.frame])
    return Figure(
        id=name,
        title=f"Row {row.name}: footage at {structure.id}",
        description=f"What the camera saw {stamp:.1f} s into {row.frames.passes[still.frame]}, with the map over it.",
        frame=frame,
        layers=tuple(layers),
        labels=(Label(WIDTH // 2, HEIGHT // 2, structure.id, "on-photo middle", dy=-1.2),),
        note=why,
        backdrop=Backdrop(f"data:image/jpeg;base64,{base64.b64encode(_view(still, spec)).decode()}", frame),
    )


def aimed(pose: Floats, target: Floats) -> ViewSpec:
    """A view of a rig at `pose` (4, 4) whose middle shows a point (3,) of the row, with what is up in the row upwards."""
    ahead = pose[:3, :3].T @ (target - pose[:3, 3])
    down = -pose[1, :3]
    forward = ahead / max(float(np.linalg.norm(ahead)), 1e-9)
    right = np.cross(down, forward)
    if np.linalg.norm(right) < 1e-6:  # straight up or down
        right = pose[0, :3] - forward * (pose[0, :3] @ forward)
    right /= np.linalg.norm(right)
    turn = np.stack([right, np.cross(forward, right), forward], axis=1)
    yaw, pitch, roll = pinhole.angles_from_rotation(turn)
    return ViewSpec("footage", yaw, pitch, roll, HFOV_DEG, WIDTH, HEIGHT)


def _lines(structure: Structure, spec: ViewSpec, pose: Floats) -> str:
    """A structure's edges in a view, as one path; empty where none is in front of the camera."""
    seen = (structure.vertices - pose[:3, 3]) @ pose[:3, :3] @ spec.rig_from_view
    drawn = (_cut(seen[first], seen[last]) for first, last in structure.edges.tolist())
    pixels = (_pixels(ends, spec) for ends in drawn if ends is not None)
    return "".join(path(ends) for ends in pixels if _within(ends))


def _cut(first: Floats, last: Floats) -> Floats | None:
    """The part (2, 3) of a line that lies in front of the camera."""
    if max(first[2], last[2]) <= NEAR_M:
        return None
    ends = np.stack([first, last])
    for end, other in ((0, 1), (1, 0)):
        if ends[end, 2] < NEAR_M:
            share = (NEAR_M - ends[end, 2]) / (ends[other, 2] - ends[end, 2])
            ends[end] += share * (ends[other] - ends[end])
    return ends


def _pixels(ends: Floats, spec: ViewSpec) -> Floats:
    homogeneous = ends @ spec.camera.T
    return np.asarray(homogeneous[:, :2] / homogeneous[:, 2:])


def _within(ends: Floats) -> bool:
    """Whether a line may be seen in the picture."""
    low, high = ends.min(axis=0), ends.max(axis=0)
    return bool(low[0] < WIDTH and low[1] < HEIGHT and high[0] > 0 and high[1] > 0)


def _view(still: Still, spec: ViewSpec) -> bytes:
    image = np.asarray(cv2.imdecode(still.picture, cv2.IMREAD_COLOR), np.uint8)[..., ::-1]
    shown = Renderer().render(Panorama(still.frame, 0.0, np.ascontiguousarray(image)), spec).image
    return cv2.imencode(".jpg", shown[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])[1].tobytes()
