"""The choice of a device that decodes; none is needed for these."""

from pathlib import Path

import pytest
from av.codec.hwaccel import HWAccel

from savmap.errors import VideoError
from savmap.video import container
from savmap.video.reader import Clip, panoramas

from .made_up_video import evenly, write_video

BUILT_WITH = ["cuda", "vaapi", "drm", "qsv"]


@pytest.mark.parametrize(
    ("wish", "names"),
    [
        ("auto", ["cuda", "vaapi", "qsv"]),
        ("", ["cuda", "vaapi", "qsv"]),
        ("off", []),
        ("VAAPI", ["vaapi"]),
        ("metal", []),
    ],
)
def test_what_is_tried(wish: str, names: list[str]) -> None:
    assert container.candidates(wish, BUILT_WITH) == names


@pytest.fixture
def tried(monkeypatch: pytest.MonkeyPatch) -> list[object]:
    monkeypatch.setattr(container, "_WORKING", {})
    monkeypatch.setattr(container, "hwdevices_available", lambda: BUILT_WITH)
    monkeypatch.delenv(container.HARDWARE_VARIABLE, raising=False)
    return []


def test_the_first_that_decodes_is_taken_and_asked_once(tried: list[object]) -> None:
    def decodes(device: HWAccel) -> bool:
        tried.append(device)
        if len(tried) == 1:
            raise PermissionError("no such device")
        return len(tried) == 3

    chosen = [container.accelerator("hevc", decodes) for _ in range(2)]
    assert len(tried) == 3
    assert all(isinstance(device, HWAccel) for device in chosen)


@pytest.mark.parametrize("error", [None, VideoError("gone"), RuntimeError("no stream is compatible")])
def test_without_one_the_processor_decodes(tried: list[object], error: Exception | None) -> None:
    def decodes(device: HWAccel) -> bool:
        tried.append(device)
        if error is not None:
            raise error
        return False

    assert container.accelerator("hevc", decodes) is None
    assert container.accelerator("hevc", decodes) is None
    assert len(tried) == 3


def test_large_video_decodes_the_same_without_a_device(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Devices are really tried here: those that FFmpeg knows and this machine lacks."""
    path = write_video(tmp_path / "a.mp4", evenly(6, 15))
    plain = [panorama.image for panorama in panoramas(Clip(path))]
    monkeypatch.setattr(container, "LARGE_PIXELS", 100)
    monkeypatch.setattr(container, "_WORKING", {})
    again = [panorama.image for panorama in panoramas(Clip(path))]
    assert container._WORKING
    assert all((one == other).all() for one, other in zip(plain, again, strict=True))
