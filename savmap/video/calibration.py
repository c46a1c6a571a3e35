"""Calibration files of cameras: as OpenCV, ROS (`camera_info`) and Kalibr (`camchain`) write them, in YAML or JSON."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from ruamel.yaml import YAML
from ruamel.yaml.constructor import SafeConstructor
from ruamel.yaml.error import YAMLError
from ruamel.yaml.nodes import MappingNode

from savmap.errors import SiteError
from savmap.geometry.cameras import Camera, Fisheye, FisheyePair, Pinhole

OPENCV_TAG = "tag:yaml.org,2002:opencv-matrix"
RADIAL, FISHEYES = ("", "plumb_bob", "rational_polynomial", "radtan"), ("equidistant", "fisheye", "kannala_brandt")
FIRST, SECOND = "cam0", "cam1"
MOST_TERMS = {Pinhole: 8, Fisheye: 4}
ASPECT = 0.01
"""By how much the shapes of pictures and of a calibration's may differ."""


class _Constructor(SafeConstructor):
    """With OpenCV's matrices."""


def _matrix(constructor: SafeConstructor, node: MappingNode) -> dict[Any, Any]:
    return dict(constructor.construct_mapping(node, deep=True))


_Constructor.add_constructor(OPENCV_TAG, _matrix)


def camera_from(path: Path, width: int, height: int) -> Camera:
    """The camera that a calibration file describes, for pictures of this size; of a chain of two fisheye cameras the
    pair. Raises SiteError where the file cannot be read, lacks a number, or is of pictures of another shape."""
    content = _content(path)
    try:
        if FIRST not in content:
            return _scaled(path, content, width, height)
        if SECOND not in content:
            return _scaled(path, content[FIRST], width, height)
        left, right = (_scaled(path, content[name], width // 2, height) for name in (FIRST, SECOND))
        if not (isinstance(left, Fisheye) and isinstance(right, Fisheye)):
            raise SiteError(f"{path}: of two cameras only fisheye ones are read, as the lenses of one picture")
        right_from_left = np.array(content[SECOND]["T_cn_cnm1"], np.float64)[:3, :3]
        return FisheyePair(left, right, np.eye(3), right_from_left.T)
    except (KeyError, TypeError, ValueError, IndexError) as error:
        raise SiteError(
            f"{path}: no calibration that is read: {error!r}; give one of OpenCV, ROS (camera_info) or Kalibr"
        ) from error


def _content(path: Path) -> Mapping[str, Any]:
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise SiteError(f"{path}: the calibration cannot be read: {error}") from error
    yaml = YAML(typ="safe", pure=True)
    yaml.Constructor = _Constructor
    try:
        content = yaml.load(text.removeprefix("%YAML:1.0"))
    except YAMLError as error:
        raise SiteError(f"{path}: the calibration is neither YAML nor JSON: {' '.join(str(error).split())}") from error
    if not isinstance(content, Mapping):
        raise SiteError(f"{path}: the calibration holds no keys; give one of OpenCV, ROS (camera_info) or Kalibr")
    return content


def _scaled(path: Path, content: Mapping[str, Any], width: int, height: int) -> Camera:
    """One camera; the calibration may be of pictures of another size, but not of another shape."""
    fx, fy, cx, cy = _intrinsics(content)
    of_width, of_height = _size(content) or (width, height)
    across, down = width / of_width, height / of_height
    if abs(across / down - 1) > ASPECT:
        raise SiteError(
            f"{path}: the calibration is of pictures of {of_width}x{of_height}, and these are {width}x{height}: "
            "of another shape"
        )
    focal = float(fx * across), float(fy * down)
    centre = float((cx + 0.5) * across - 0.5), float((cy + 0.5) * down - 0.5)
    model = str(content.get("distortion_model") or content.get("model") or "").lower()
    kind: type[Pinhole] | type[Fisheye] = Fisheye if model in FISHEYES else Pinhole
    if kind is Pinhole and model not in (*RADIAL, "pinhole"):
        raise SiteError(f"{path}: the distortion model {model} is not read; {', '.join((*RADIAL[1:], *FISHEYES))} are")
    terms = _numbers(_first_of(content, "distortion_coefficients", "distortion_coeffs", "dist_coeffs", "D", "d") or ())
    if len(terms) > MOST_TERMS[kind]:
        raise SiteError(f"{path}: {len(terms)} terms of distortion; at most {MOST_TERMS[kind]} are read")
    return kind(width, height, focal, centre, tuple(terms))


def _intrinsics(content: Mapping[str, Any]) -> list[float]:
    """Focal lengths and principal point, px."""
    if "intrinsics" in content:
        return _numbers(content["intrinsics"])[-4:]
    matrix = _numbers(_first_of(content, "camera_matrix", "Camera_Matrix", "K", "k"))
    if len(matrix) != 9:
        raise ValueError("a camera matrix of 9 numbers is missing")
    return [matrix[0], matrix[4], matrix[2], matrix[5]]


def _size(content: Mapping[str, Any]) -> tuple[int, int] | None:
    if "resolution" in content:
        width, height = content["resolution"]
        return int(width), int(height)
    for across, down in (("image_width", "image_height"), ("image_Width", "image_Height"), ("width", "height")):
        if across in content and down in content:
            return int(content[across]), int(content[down])
    return None


def _first_of(content: Mapping[str, Any], *names: str) -> Any:
    return next((content[name] for name in names if name in content), None)


def _numbers(value: Any) -> list[float]:
    """Numbers in a list, a matrix, or a section with `data`."""
    if isinstance(value, Mapping):
        value = value["data"]
    return [float(number) for number in np.ravel(np.asarray(value, np.float64))]
