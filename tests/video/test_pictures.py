"""Pictures as cameras and phones write them: turned by their EXIF data, and with more behind the end of a JPEG."""

import io
from pathlib import Path

import numpy as np
import pytest
from PIL import Image, ImageOps

from savmap.errors import VideoError
from savmap.video.clip import Clip, DecodeReport
from savmap.video.image_folder import picture_size, read_picture
from savmap.video.reader import panoramas, probe

from .made_up_video import picture

ORIENTATION = 0x0112
TURNS = {
    1: lambda shown: shown,
    2: lambda shown: shown[:, ::-1],
    3: lambda shown: shown[::-1, ::-1],
    4: lambda shown: shown[::-1],
    5: lambda shown: shown.swapaxes(0, 1),
    6: lambda shown: np.rot90(shown),
    7: lambda shown: shown.swapaxes(0, 1)[::-1, ::-1],
    8: lambda shown: np.rot90(shown, -1),
}
"""By orientation, how a picture must be stored that is to be shown like this."""


def stored(shown: np.ndarray, orientation: int, kind: str) -> bytes:
    """A file whose pixels are turned, so that it is shown like this."""
    exif = Image.Exif()
    exif[ORIENTATION] = orientation
    file = io.BytesIO()
    options = {"quality": 95} if kind == "jpeg" else {"lossless": True} if kind == "webp" else {}
    Image.fromarray(np.ascontiguousarray(TURNS[orientation](shown))).save(file, kind, exif=exif, **options)
    return file.getvalue()


def folder_of(folder: Path, pictures: list[bytes], suffix: str) -> Path:
    folder.mkdir()
    for index, content in enumerate(pictures):
        (folder / f"{index:04}.{suffix}").write_bytes(content)
    return folder


@pytest.mark.parametrize(
    ("kind", "orientation"), [*(("jpeg", turn) for turn in TURNS), ("png", 6), ("webp", 8), ("tiff", 5)]
)
def test_a_picture_is_read_as_it_is_to_be_shown(tmp_path: Path, kind: str, orientation: int) -> None:
    contents = [stored(picture(index), orientation, kind) for index in range(3)]
    with Image.open(io.BytesIO(contents[0])) as opened:
        assert np.abs(np.asarray(ImageOps.exif_transpose(opened)).astype(int) - picture(0)).max() < 30
    folder = folder_of(tmp_path / "pictures", contents, kind)
    assert (probe(folder).width, probe(folder).height) == (128, 64)
    report = DecodeReport()
    for index, panorama in enumerate(panoramas(Clip(folder, fps=30), report=report)):
        assert np.abs(panorama.image.astype(int) - picture(index)).mean() < 4
    assert (report.used, report.skipped) == (3, 0)


def test_a_panorama_to_be_shown_upright_is_refused_at_once(tmp_path: Path) -> None:
    folder = folder_of(tmp_path / "pictures", [stored(TURNS[8](picture(0)), 6, "jpeg")], "jpg")
    with pytest.raises(VideoError, match="64x128, not 2:1"):
        probe(folder)


def test_pictures_of_one_folder_may_be_turned_differently(tmp_path: Path) -> None:
    contents = [stored(picture(index), orientation, "jpeg") for index, orientation in enumerate((1, 3, 6, 2))]
    folder = folder_of(tmp_path / "pictures", contents, "jpg")
    found = list(panoramas(Clip(folder, fps=30)))
    assert len(found) == 4
    assert all(np.abs(one.image.astype(int) - picture(index)).mean() < 4 for index, one in enumerate(found))


def jpeg(thumbnail: bool = False, progressive: bool = False) -> bytes:
    """A JPEG; with a preview, its EXIF data hold a picture with an end marker of its own."""
    file, small = io.BytesIO(), io.BytesIO()
    Image.fromarray(picture(3, 32, 16)).save(small, "jpeg")
    exif = b"Exif\0\0II*\0\x08\0\0\0\0\0\0\0\0\0" + small.getvalue() if thumbnail else b""
    Image.fromarray(picture(0)).save(file, "jpeg", quality=90, exif=exif, progressive=progressive)
    return file.getvalue()


def second_picture() -> bytes:
    """A picture with another behind it, as phones write them (CIPA DC-007)."""
    file = io.BytesIO()
    Image.fromarray(picture(0)).save(
        file, "mpo", save_all=True, append_images=[Image.fromarray(picture(9))], quality=90
    )
    return file.getvalue()


@pytest.mark.parametrize(
    "content",
    [
        pytest.param(jpeg() + bytes(5000), id="zeros"),
        pytest.param(jpeg() + b"\0\0\x81\x0a" + b"SEFHk\0\0\0" * 300 + b"SEFT", id="Samsung"),
        pytest.param(jpeg(True) + b"\0\0\0\x18ftypmp42" + bytes(range(256)) * 40, id="motion photo"),
        pytest.param(jpeg() + bytes(2000) + b"8db42d694ccc418790edff439fe026bf", id="Insta360"),
        pytest.param(jpeg(progressive=True) + bytes(range(256)) * 9, id="progressive"),
        pytest.param(jpeg()[:-2] + b"\xff\xff\xff\xd9" + bytes(1500), id="fill bytes"),
        pytest.param(second_picture() + bytes(1500), id="second picture"),
    ],
)
def test_what_stands_behind_a_jpeg_is_not_read(
    tmp_path: Path, content: bytes, capfd: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "a.jpg"
    path.write_bytes(content)
    found = read_picture(path, (128, 64))
    assert found is not None
    assert np.abs(found.astype(int) - picture(0)).mean() < 4
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("thumbnail", [False, True])
@pytest.mark.parametrize("progressive", [False, True])
def test_a_jpeg_that_is_cut_off_is_damaged(tmp_path: Path, thumbnail: bool, progressive: bool) -> None:
    path, content = tmp_path / "a.jpg", jpeg(thumbnail, progressive)
    for length in {*range(0, len(content), 97), len(content) - 1, len(content) - 2}:
        path.write_bytes(content[:length])
        assert read_picture(path, (128, 64)) is None
    path.write_bytes(content)
    assert read_picture(path, (128, 64)) is not None
    assert picture_size(path) == (128, 64)
