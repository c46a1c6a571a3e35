"""The located frames of a map, pass by pass, in the world's frame, for programs of SLAM and neural rendering: TUM,
COLMAP, nerfstudio."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from savmap.errors import OutputError, visible
from savmap.files.atomic import write_text
from savmap.maps.exports.files import json_text, write_archive
from savmap.maps.exports.frames import drives, elements
from savmap.maps.exports.marks import commented, remarks, unique
from savmap.types import Floats, Ints, SiteMap, array_record

WIDTH_PX, HEIGHT_PX = 3840, 1920
"""Of a panorama, nominally: a map does not say how large its pictures were."""
OPENGL_FROM_RIG = np.diag([1.0, -1.0, -1.0, 1.0])
"""A camera of OpenGL and nerfstudio looks along -z, with y up."""
GREY = "160 160 160"


@dataclass(frozen=True, eq=False)
@array_record
class PassFrames:
    """The located frames of one pass: numbers (n) in the row, times (n) s in the pass's video, world_from_rig (n, 4,
    4), z up; the rig's axes are x right, y down, z ahead. `folder`: row and pass as the name of a folder, of letters,
    digits, dots, dashes and underscores; no other pass of the map has it, nor one that differs by capitals only."""

    row: str
    name: str
    folder: str
    numbers: Ints
    stamps_s: Floats
    world_from_rig: Floats

    def pictures(self) -> list[str]:
        """A file name for each frame's panorama: its time in the video, in milliseconds."""
        return [f"{self.folder}/{round(1000 * stamp):08d}.jpg" for stamp in self.stamps_s.tolist()]


def passes(site: SiteMap) -> Iterator[PassFrames]:
    """All passes of all rows with located frames. Raises OutputError where rows have no common frame."""
    driven = drives(site)
    for drive, folder in zip(driven, _folders([drive.row for drive in driven]), strict=True):
        names = list(dict.fromkeys(drive.passes))
        for name, inner in zip(names, _folders(names), strict=True):
            here = np.array([other == name for other in drive.passes])
            frames = drive.frames[here], drive.stamps_s[here], drive.world_from_rig[here]
            yield PassFrames(drive.row, name, f"{folder}/{inner}", *frames)


def _folders(names: Sequence[str]) -> list[str]:
    """Texts as parts of paths: what is no letter or digit of ASCII, dot, dash or underscore becomes an underscore."""
    kept = (
        "".join(
            letter if letter.isascii() and (letter.isalnum() or letter in ".-_") else "_" for letter in visible(name)
        )
        for name in names
    )
    return unique([text.lstrip(".") or "_" for text in kept], key=str.casefold)


def _driven(site: SiteMap) -> list[PassFrames]:
    """The passes of all rows. Raises OutputError where there is none."""
    driven = list(passes(site))
    if not driven:
        raise OutputError("the map holds no camera path, and this format is of nothing else")
    return driven


def write_tum(site: SiteMap, path: Path) -> None:
    """TUM's text: time in s, position in m, quaternion x y z w of world_from_rig; one pass, or a zip of all where the
    path ends with .zip. Raises OutputError for several passes and another ending, and for a map without a camera
    path."""
    driven = _driven(site)
    head = commented(remarks(site.rows.values()))
    if path.suffix == ".zip":
        return write_archive(path, {f"{frames.folder}.tum": head + _tum(frames) for frames in driven})
    if len(driven) != 1:
        raise OutputError(
            f"{path}: a TUM file holds one pass, and the map has {len(driven)}: name a .zip, or choose with --row"
        )
    write_text(path, head + _tum(driven[0]))


def _tum(frames: PassFrames) -> str:
    quaternions = Rotation.from_matrix(frames.world_from_rig[:, :3, :3]).as_quat(canonical=True)
    numbers = np.hstack([frames.stamps_s[:, None], frames.world_from_rig[:, :3, 3], quaternions])
    lines = (" ".join(f"{value:.9f}" for value in line) + "\n" for line in numbers)
    return "# timestamp tx ty tz qx qy qz qw\n" + "".join(lines)


def write_nerfstudio(site: SiteMap, path: Path) -> None:
    """nerfstudio's transforms.json: world_from_camera of panoramas in OpenGL's axes, z up. Raises OutputError for a map
    without a camera path."""
    frames = [
        {"file_path": f"images/{picture}", "transform_matrix": (pose @ OPENGL_FROM_RIG).round(9).tolist()}
        for driven in _driven(site)
        for picture, pose in zip(driven.pictures(), driven.world_from_rig, strict=True)
    ]
    half = WIDTH_PX / 2
    camera = {"camera_model": "EQUIRECTANGULAR", "w": WIDTH_PX, "h": HEIGHT_PX, "fl_x": half, "fl_y": half}
    centre = {"cx": WIDTH_PX / 2, "cy": HEIGHT_PX / 2, "orientation_override": "none"}
    write_text(path, json_text({**camera, **centre, "remarks": remarks(site.rows.values()), "frames": frames}))


def write_colmap(site: SiteMap, path: Path) -> None:
    """A zip of COLMAP's text model: one EQUIRECTANGULAR camera, an image for each located frame, and the map's vertices
    as points, which no image sees. COLMAP's pixel centres lie at halves: its x is savmap's and 0.5. Raises OutputError
    for a map without a camera path."""
    frames = [pair for driven in _driven(site) for pair in zip(driven.pictures(), driven.world_from_rig, strict=True)]
    images = []
    for number, (name, pose) in enumerate(frames, 1):
        turn = pose[:3, :3].T
        x, y, z, w = Rotation.from_matrix(turn).as_quat(canonical=True)
        numbers = " ".join(f"{value:.9f}" for value in (w, x, y, z, *(-turn @ pose[:3, 3])))
        images.append(f"{number} {numbers} 1 {name}\n\n")
    points = list[str]()
    for element in elements(site):
        sigmas = np.sqrt(np.trace(element.structure.covariances, axis1=1, axis2=2) / 3)
        for (x, y, z), sigma in zip(element.structure.vertices, sigmas, strict=True):
            points.append(f"{len(points) + 1} {x:.6f} {y:.6f} {z:.6f} {GREY} {sigma:.6f}\n")
    size = f"{WIDTH_PX} {HEIGHT_PX}"
    files = {
        "cameras.txt": f"# CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n1 EQUIRECTANGULAR {size} {size}\n",
        "images.txt": "# IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME\n# POINTS2D[]\n" + "".join(images),
        "points3D.txt": commented(remarks(site.rows.values()))
        + "# POINT3D_ID, X, Y, Z, R, G, B, ERROR, TRACK[]\n"
        + "".join(points),
    }
    write_archive(path, files)
