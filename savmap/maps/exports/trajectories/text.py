"""Trajectories for programs of SLAM and neural rendering: TUM, COLMAP, nerfstudio."""

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from savmap.errors import OutputError
from savmap.files.atomic import write_text
from savmap.maps.exports.archive import write_archive
from savmap.maps.exports.frames import Element, elements
from savmap.maps.exports.json_text import json_text
from savmap.maps.exports.trajectories.passes import HEIGHT_PX, WIDTH_PX, PassFrames, passes
from savmap.types import Floats, SiteMap

OPENGL_FROM_RIG = np.diag([1.0, -1.0, -1.0, 1.0])
"""A camera of OpenGL and nerfstudio looks along -z, with y up."""
GREY = "160 160 160"


def write_tum(site: SiteMap, path: Path) -> None:
    """TUM's text: time in s, position in m, quaternion x y z w of world_from_rig; one pass, or a zip of all where the
    path ends with .zip. Raises OutputError for several passes and another ending, and for a map without a camera
    path."""
    found = _driven(site)
    if path.suffix == ".zip":
        return write_archive(path, {f"{each.folder}.tum": _tum(each).encode() for each in found})
    if len(found) != 1:
        raise OutputError(
            f"{path}: a TUM file holds one pass, and the map has {len(found)}: name a .zip, or choose with --row"
        )
    write_text(path, _tum(found[0]))


def write_nerfstudio(site: SiteMap, path: Path) -> None:
    """nerfstudio's transforms.json: world_from_camera of panoramas in OpenGL's axes, z up. Raises OutputError for a map
    without a camera path."""
    frames = [
        {"file_path": f"images/{picture}", "transform_matrix": (pose @ OPENGL_FROM_RIG).round(9).tolist()}
        for each in _driven(site)
        for picture, pose in zip(each.pictures(), each.world_from_rig, strict=True)
    ]
    half = WIDTH_PX / 2
    camera = {"camera_model": "EQUIRECTANGULAR", "w": WIDTH_PX, "h": HEIGHT_PX, "fl_x": half, "fl_y": half}
    centre = {"cx": WIDTH_PX / 2, "cy": HEIGHT_PX / 2, "orientation_override": "none"}
    write_text(path, json_text({**camera, **centre, "frames": frames}))


def write_colmap(site: SiteMap, path: Path) -> None:
    """A zip of COLMAP's text model: one EQUIRECTANGULAR camera, an image for each located frame, and the map's vertices
    as points, which no image sees. COLMAP's pixel centres lie at halves: its x is savmap's and 0.5. Raises OutputError
    for a map without a camera path."""
    images = [_image(*one) for one in enumerate(_frames(_driven(site)), 1)]
    files = {
        "cameras.txt": f"# CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n1 EQUIRECTANGULAR {WIDTH_PX} {HEIGHT_PX} {WIDTH_PX} {HEIGHT_PX}\n",
        "images.txt": "# IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME\n# POINTS2D[]\n" + "".join(images),
        "points3D.txt": "# POINT3D_ID, X, Y, Z, R, G, B, ERROR, TRACK[]\n" + "".join(_points(elements(site))),
    }
    write_archive(path, {name: text.encode() for name, text in files.items()})


def _driven(site: SiteMap) -> list[PassFrames]:
    """The passes of all rows. Raises OutputError where there is none."""
    found = passes(site)
    if not found:
        raise OutputError("the map holds no camera path, and this format is of nothing else")
    return found


def _tum(each: PassFrames) -> str:
    quaternions = Rotation.from_matrix(each.world_from_rig[:, :3, :3]).as_quat(canonical=True)
    numbers = np.hstack([each.stamps_s[:, None], each.world_from_rig[:, :3, 3], quaternions])
    return "# timestamp tx ty tz qx qy qz qw\n" + "".join(_line(line, 9) for line in numbers)


def _frames(found: Sequence[PassFrames]) -> Iterator[tuple[str, Floats]]:
    for each in found:
        yield from zip(each.pictures(), each.world_from_rig, strict=True)


def _image(number: int, frame: tuple[str, Floats]) -> str:
    name, pose = frame
    turn = pose[:3, :3].T
    x, y, z, w = Rotation.from_matrix(turn).as_quat(canonical=True)
    numbers = " ".join(f"{value:.9f}" for value in (w, x, y, z, *(-turn @ pose[:3, 3])))
    return f"{number} {numbers} 1 {name}\n\n"


def _points(found: Sequence[Element]) -> Iterator[str]:
    number = 0
    for element in found:
        sigmas = np.sqrt(np.trace(element.structure.covariances, axis1=1, axis2=2) / 3)
        for place, sigma in zip(element.structure.vertices, sigmas, strict=True):
            number += 1
            x, y, z = place
            yield f"{number} {x:.6f} {y:.6f} {z:.6f} {GREY} {sigma:.6f}\n"


def _line(numbers: Floats, decimals: int) -> str:
    return " ".join(f"{value:.{decimals}f}" for value in numbers) + "\n"
