"""The path of a drive through a corridor without any structure, and the picture of its wall."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from typer.testing import CliRunner

from savmap.apps.plane.wall import BesideDrive, map_plane
from savmap.cli.app import app
from savmap.errors import SiteError
from savmap.geometry.sphere import rays_from_panorama_pixels
from savmap.maps.map_file import read_map
from savmap.site.job import side_of
from savmap.types.progress import SilentMonitor

HEIGHT, WALL_M, STEP_M, FRAMES = 256, 1.6, 0.25, 16
SQUARE_M = 0.3


def tiles(seed: int) -> np.ndarray:
    return np.random.default_rng(seed).integers(40, 216, (64, 256)).astype(np.uint8)


def corridor(x: float) -> np.ndarray:
    """A panorama (HEIGHT, 2 HEIGHT, 3) from `x` m along a corridor of square tiles: walls to both sides, floor and
    ceiling, each at its distance, and ends far away."""
    columns, rows = np.meshgrid(np.arange(2 * HEIGHT, dtype=float), np.arange(HEIGHT, dtype=float))
    rays = rays_from_panorama_pixels(np.stack([columns, rows], axis=-1), HEIGHT)
    right, down, ahead = np.moveaxis(rays, -1, 0)
    picture, nearest = np.zeros((HEIGHT, 2 * HEIGHT), np.uint8), np.full((HEIGHT, 2 * HEIGHT), np.inf)
    walls = ((-right, WALL_M, down), (right, 2.0, down), (down, 1.7, right), (-down, 1.5, right))
    for number, (towards, distance, across) in enumerate(walls):
        reach = np.where(towards > 1e-6, distance / np.maximum(towards, 1e-6), np.inf)
        here = (reach < nearest) & (reach < 40)
        along, over = x + ahead[here] * reach[here], across[here] * reach[here]
        cells = np.floor(over / SQUARE_M).astype(int) % 64, np.floor(along / SQUARE_M).astype(int) % 256
        picture[here] = tiles(number)[cells]
        nearest[here] = reach[here]
    return cv2.cvtColor(picture, cv2.COLOR_GRAY2RGB)


@pytest.fixture(scope="module")
def frames(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("corridor")
    for number in range(FRAMES):
        cv2.imwrite(str(folder / f"{number:03d}.png"), corridor(number * STEP_M))
    return folder


@pytest.fixture(scope="module")
def result(frames: Path, tmp_path_factory: pytest.TempPathFactory) -> BesideDrive:
    return map_plane(frames, "left", WALL_M, tmp_path_factory.mktemp("out"), SilentMonitor())


def test_plane_path_of_a_corridor_is_as_long_as_it_is(result: BesideDrive) -> None:
    places = result.path.world_from_rig[:, :3, 3]
    keys = np.ptp(result.site_map.rows["1"].frames.stamps_s[result.path.frames]) * 30
    assert result.length_m == pytest.approx(keys * STEP_M, rel=0.03)
    assert np.ptp(places[:, 1:], axis=0) == pytest.approx([0.0, 0.0], abs=0.05)
    assert np.all(np.diff(places[:, 0]) > 0)


def test_plane_picture_shows_the_walls_squares_square(result: BesideDrive) -> None:
    photo = result.photo
    assert photo is not None
    picture = np.asarray(cv2.imdecode(photo.picture, cv2.IMREAD_GRAYSCALE), float)
    middle = picture[len(picture) // 4 : -len(picture) // 4, len(picture[0]) // 4 : -len(picture[0]) // 4]
    for axis in (0, 1):
        edges = np.abs(np.diff(middle, axis=axis)).mean(axis=1 - axis)
        spectrum = np.abs(np.fft.rfft(edges - edges.mean(), 4096))
        period_m = photo.pixel_m * 4096 / (20 + int(spectrum[20:].argmax()))
        assert SQUARE_M / period_m == pytest.approx(round(SQUARE_M / period_m), abs=0.08)


def test_plane_command_tells_the_path_and_the_files(frames: Path, tmp_path: Path) -> None:
    given = ["plane", str(frames), "--side", "left", "--distance", "1.6", "-o", str(tmp_path / "out")]
    result = CliRunner().invoke(app, given)
    assert result.exit_code == 0
    assert "key frames is" in result.output
    assert (tmp_path / "out" / "plane.jpg").is_file()
    assert read_map(tmp_path / "out" / "map.json").rows["1"].structures == {}


def test_plane_side_is_left_or_right(frames: Path, tmp_path: Path) -> None:
    with pytest.raises(SiteError, match="it is `left` or `right`"):
        side_of("up")
