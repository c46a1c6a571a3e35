"""Calibration files of OpenCV, ROS and Kalibr, and what is wrong with others."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from savmap.errors import SiteError
from savmap.geometry.cameras import Fisheye, FisheyePair, Pinhole
from savmap.video.calibration import camera_from

ROS = """
image_width: 640
image_height: 480
camera_name: narrow
camera_matrix: {rows: 3, cols: 3, data: [500.0, 0.0, 320.0, 0.0, 510.0, 235.0, 0.0, 0.0, 1.0]}
distortion_model: plumb_bob
distortion_coefficients: {rows: 1, cols: 5, data: [-0.25, 0.08, 0.001, -0.0005, 0.0]}
"""
LENS = """
  camera_model: pinhole
  intrinsics: [250.0, 252.0, 399.5, 401.0]
  distortion_model: equidistant
  distortion_coeffs: [0.02, -0.01, 0.003, -0.0005]
  resolution: [800, 800]
"""
KALIBR = f"cam0:{LENS}cam1:{LENS}  T_cn_cnm1: [[-1, 0, 0, 0], [0, 1, 0, 0], [0, 0, -1, 0.03], [0, 0, 0, 1]]\n"


def written(path: Path, text: str) -> Path:
    path.write_text(text, encoding="utf-8")
    return path


def test_ros_camera_info_is_read(tmp_path: Path) -> None:
    camera = camera_from(written(tmp_path / "a.yaml", ROS), 640, 480)
    assert camera == Pinhole(640, 480, (500.0, 510.0), (320.0, 235.0), (-0.25, 0.08, 0.001, -0.0005, 0.0))


def test_a_calibration_is_scaled_to_the_pictures(tmp_path: Path) -> None:
    camera = camera_from(written(tmp_path / "a.yaml", ROS), 1280, 960)
    assert isinstance(camera, Pinhole)
    assert (camera.focal_px, camera.centre_px) == ((1000.0, 1020.0), (640.5, 470.5))


def test_opencvs_own_file_is_read(tmp_path: Path) -> None:
    path = tmp_path / "a.yml"
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    storage.write("camera_matrix", np.array([[500.0, 0, 320], [0, 510, 235], [0, 0, 1]]))
    storage.write("distortion_coefficients", np.array([[-0.25, 0.08, 0.001, -0.0005, 0.0]]))
    storage.release()
    camera = camera_from(path, 640, 480)
    assert camera == Pinhole(640, 480, (500.0, 510.0), (320.0, 235.0), (-0.25, 0.08, 0.001, -0.0005, 0.0))


def test_kalibrs_chain_of_two_fisheyes_is_a_pair(tmp_path: Path) -> None:
    camera = camera_from(written(tmp_path / "a.yaml", KALIBR), 1600, 800)
    lens = Fisheye(800, 800, (250.0, 252.0), (399.5, 401.0), (0.02, -0.01, 0.003, -0.0005))
    assert isinstance(camera, FisheyePair)
    assert (camera.left, camera.right) == (lens, lens)
    np.testing.assert_array_equal(camera.rig_from_right, np.diag([-1.0, 1.0, -1.0]))
    assert camera_from(written(tmp_path / "one.yaml", f"cam0:{LENS}"), 800, 800) == lens


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("nothing: here", "no calibration that is read"),
        ("- 1\n- 2", "holds no keys"),
        ("a: [", "neither YAML nor JSON"),
        (ROS.replace("640", "480"), "of another shape"),
        (ROS.replace("plumb_bob", "fov"), "distortion model fov is not read"),
        (ROS.replace("0.0]}\n", "0.0, 0, 0, 0, 0]}\n", 2), "at most 8 are read"),
        (KALIBR.replace("equidistant", "radtan").replace("[800, 800]", "[320, 480]"), "only fisheye ones"),
    ],
)
def test_other_files_are_refused_in_one_line(tmp_path: Path, text: str, says: str) -> None:
    with pytest.raises(SiteError, match=says) as error:
        camera_from(written(tmp_path / "a.yaml", text), 640, 480)
    assert str(error.value).startswith(f"{tmp_path / 'a.yaml'}: ")
    assert "\n" not in str(error.value)


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(SiteError, match="cannot be read"):
        camera_from(tmp_path / "a.yaml", 640, 480)
