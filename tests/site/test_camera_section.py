"""The camera of a site file and of the command line: what is meant, and what is wrong in one line."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from savmap.errors import SiteError
from savmap.geometry.cameras import Fisheye, FisheyePair, Pinhole
from savmap.site.job import camera_content, job_for
from savmap.site.load import load_site
from savmap.site.model import Site
from savmap.site.preflight import footage
from savmap.site.sections import CameraSection
from savmap.video.clip import Clip

from ..video.made_up_video import evenly, write_video


def clip(of_pass: dict[str, Any] | None = None, **of_site: Any) -> Clip:
    site = Site.model_validate({**of_site, "rows": {"A": {"passes": [{"video": "a.mp4", **(of_pass or {})}]}}})
    return site.rows["A"].passes[0].clip


def test_a_field_of_view_is_enough() -> None:
    pinhole = CameraSection(model="pinhole", hfov_deg=75).camera(1138, 640)
    assert isinstance(pinhole, Pinhole)
    assert pinhole.focal_px[0] == pytest.approx(741.5, abs=0.1)
    fisheye = CameraSection(model="fisheye", hfov_deg=180).camera(800, 600)
    assert isinstance(fisheye, Fisheye)
    np.testing.assert_allclose(fisheye.rays(np.array([[-0.5, 299.5]])), [[-1.0, 0.0, 0.0]], atol=1e-9)
    pair = CameraSection(model="fisheye-pair").camera(1600, 800)
    assert isinstance(pair, FisheyePair)
    assert pair.rays(np.array([[1199.5, 399.5]])).tolist() == [[0.0, 0.0, -1.0]]


def test_the_nearest_word_counts() -> None:
    narrow, wide = {"model": "pinhole", "hfov_deg": 60}, {"model": "pinhole", "hfov_deg": 90}
    assert clip().camera is None
    assert clip(camera={"model": "panorama"}).camera is None
    assert clip(camera=narrow).camera == CameraSection(model="pinhole", hfov_deg=60)
    assert clip({"camera": wide}, camera=narrow).camera == CameraSection(model="pinhole", hfov_deg=90)


@pytest.mark.parametrize(
    ("section", "says"),
    [
        ({"model": "phone"}, "panorama"),
        ({"hfov_deg": 75}, "Field required"),
        ({"model": "pinhole", "hfov_deg": 1.3}, "greater than 10"),
        ({"model": "pinhole", "hfov_deg": 170}, "is it a fisheye"),
        ({"model": "panorama", "hfov_deg": 75}, "needs neither"),
        ({"model": "pinhole", "hfov_deg": 75, "calibration": "a.yaml"}, "give one of them"),
    ],
)
def test_mistakes_are_named(section: dict[str, Any], says: str) -> None:
    with pytest.raises(ValidationError, match=says):
        CameraSection.model_validate(section)


def test_a_calibration_of_another_model_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.yaml"
    path.write_text("K: [500, 0, 320, 0, 500, 240, 0, 0, 1]\nmodel: fisheye\n", encoding="utf-8")
    assert isinstance(CameraSection(model="fisheye", calibration=path).camera(640, 480), Fisheye)
    with pytest.raises(SiteError, match="of another model than `pinhole`"):
        CameraSection(model="pinhole", calibration=path).camera(640, 480)


def test_a_calibration_lies_beside_the_site_file(tmp_path: Path) -> None:
    text = "rows: {A: {passes: [{video: a.mp4, camera: {model: fisheye, calibration: lens.yaml}}]}}"
    (tmp_path / "site.yaml").write_text(text, encoding="utf-8")
    camera = load_site(tmp_path / "site.yaml").rows["A"].passes[0].camera
    assert camera is not None
    assert camera.calibration == tmp_path / "lens.yaml"


def test_a_check_names_a_wrong_calibration_and_goes_on(tmp_path: Path) -> None:
    video = write_video(tmp_path / "a.mp4", evenly(12, 15))
    camera = f"{{model: fisheye, calibration: {tmp_path / 'no.yaml'}}}"
    passes = f"[{{video: {video}, camera: {camera}}}, {{video: {tmp_path / 'b.mp4'}}}]"
    (tmp_path / "site.yaml").write_text(f"rows: {{A: {{passes: {passes}}}}}", encoding="utf-8")
    first, second = footage(job_for(tmp_path / "site.yaml", None, tmp_path / "out"))
    assert "no.yaml: the calibration cannot be read" in str(first)
    assert "b.mp4: no such file" in str(second)


def test_options_are_the_section() -> None:
    assert camera_content(None, None, None) == {}
    assert camera_content("pinhole", 75.0, None) == {"model": "pinhole", "hfov_deg": 75.0}
    assert camera_content("fisheye", None, Path("/a.yaml")) == {"model": "fisheye", "calibration": "/a.yaml"}
    with pytest.raises(SiteError, match="--hfov and --calibration say more of a --camera"):
        camera_content(None, 75.0, None)
    with pytest.raises(SiteError, match="--camera phone: it is one of panorama, pinhole, fisheye, fisheye-pair"):
        camera_content("phone", None, None)
