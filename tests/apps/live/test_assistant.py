"""What the capture assistant says, and what it is silent about."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from savmap.apps.live.assistant import (
    FAR_M,
    Advice,
    CaptureAssistant,
    advice_of_map,
    horizon,
    most_urgent,
    sharpness,
)
from savmap.types import FrameTable, MapWarning, Panorama, PlanePatch, RowMap, Structure, Trajectory, Verdict

HEIGHT = 256
PANORAMA = np.random.default_rng(5).integers(40, 230, (HEIGHT // 4, 4 * HEIGHT // 8, 3)).astype(np.uint8)
BASE = cv2.resize(PANORAMA, (2 * HEIGHT, HEIGHT), interpolation=cv2.INTER_NEAREST)
Picture = NDArray[np.uint8]


def passing(image: Picture, degrees: float) -> Picture:
    """What is left and right of the way moves backwards by so many degrees."""
    height, width = image.shape[:2]
    bearing = (np.arange(width) + 0.5) / width * 2 * np.pi - np.pi
    shift = degrees / 360 * width * np.sin(bearing) * np.abs(np.sin(bearing))
    columns = (np.arange(width) - shift).astype(np.float32) % width
    rows = np.arange(height, dtype=np.float32)
    return cv2.remap(image, *np.meshgrid(columns, rows), cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP)


def walk(count: int, step_deg: float = 4.0, turn_deg: float = 0.0) -> list[Picture]:
    turned = [np.roll(BASE, round(-number * turn_deg / 360 * BASE.shape[1]), axis=1) for number in range(count)]
    return [passing(image, number * step_deg) for number, image in enumerate(turned)]


def codes(images: list[Picture], fps: float = 6.0, **settings: float) -> set[str]:
    """All that is said while these pass."""
    assistant = CaptureAssistant(facing_deg=-90.0, **settings)
    return {
        item.code
        for number, image in enumerate(images)
        for item in assistant.take(Panorama(number, number / fps, image))
    }


def test_good_walk_calls_for_nothing() -> None:
    assert codes(walk(24)) == set()


def test_dark() -> None:
    assert codes([image // 12 for image in walk(8)]) == {"dark"}


def test_turning_names_the_side_to_turn_back_to() -> None:
    assistant = CaptureAssistant()
    images = walk(10, step_deg=0.0, turn_deg=6.0)
    said = [item for number, image in enumerate(images) for item in assistant.take(Panorama(number, number / 6, image))]
    assert {(item.code, item.arrow) for item in said} == {("turning", "left")}


def test_covered_is_what_stays_while_the_rest_passes() -> None:
    images = walk(24)
    left = BASE.shape[1] // 4
    for image in images:
        image[HEIGHT // 4 : HEIGHT // 2, left - 40 : left + 40] = 5
    assert "covered" in codes(images)


def test_flicker() -> None:
    dimmed = [(image * (0.6 if number % 2 else 1.0)).astype(np.uint8) for number, image in enumerate(walk(24))]
    assert "flicker" in codes(dimmed)


def test_blurred_beside_what_was_usual() -> None:
    smeared = [cv2.blur(image, (25, 1)) for image in walk(36)[24:]]
    assert "blurred" in codes(walk(24) + smeared)


def test_tilted_camera() -> None:
    assert codes(walk(6), tilt_deg=20.0) == {"tilted"}


def test_memory_does_not_grow() -> None:
    assistant = CaptureAssistant(facing_deg=-90.0)
    for number in range(60):
        assistant.take(Panorama(number, number / 6, BASE))
    assert len(assistant._watch.steps.motions) < 20
    assert len(assistant._sharpness) <= 40


def test_sharpness_is_less_where_detail_is_smeared() -> None:
    sharp, smeared = (sharpness(Panorama(0, 0.0, image)) for image in (BASE, cv2.blur(BASE, (25, 1))))
    assert smeared < 0.5 * sharp
    assert horizon(np.zeros((64, 128), np.uint8)).shape[1] == 128


def structure(name: str, x: float) -> Structure:
    vertices = np.array([[x, 0.0, 0.0], [x, 1.0, 0.0]])
    return Structure(name, "part", vertices, np.full((2, 3, 3), 1e-4), ("low", "high"), np.array([[0, 1]]), None)


@pytest.fixture
def row() -> RowMap:
    poses = np.tile(np.eye(4), (3, 1, 1))
    poses[:, :3, 3] = [[0.0, 1.0, 1.5], [3.0, 1.0, 1.5], [6.0, 1.0, 1.5]]
    face = PlanePatch("face", np.zeros(3), np.array([1.0, 0, 0]), np.array([0.0, 1, 0]), np.array([8.0, 2.0]), 0.05)
    warning = MapWarning("uncertain-element", ("part 1",))
    return RowMap(
        "A",
        FrameTable(np.arange(3.0), ("pass 1",) * 3),
        {},
        Trajectory(np.arange(3), poses),
        {"things": (structure("part 1", 1.0), structure("part 2", 6.0))},
        (),
        face=face,
        verdict=Verdict((warning,), ()),
    )


def test_what_was_passed_and_is_uncertain_is_named(row: RowMap) -> None:
    (advice,) = advice_of_map(row, row.trajectory.world_from_rig[-1, :3, 3])
    assert (advice.code, advice.arrow) == ("go-back", "back")
    assert advice.text == "Go back 5 m: part 1 could not be seen well."


def test_what_is_still_ahead_or_abeam_is_left_alone(row: RowMap) -> None:
    assert list(advice_of_map(row, np.array([1.5, 1.0, 1.5]))) == []


def test_distance_to_the_face(row: RowMap) -> None:
    certain = replace(row, verdict=None)
    assert [item.code for item in advice_of_map(certain, np.array([6.0, 1.0, 0.3]))] == ["too-near"]
    assert [item.code for item in advice_of_map(certain, np.array([6.0, 1.0, FAR_M + 1]))] == ["too-far"]


def test_the_most_urgent_is_shown() -> None:
    stop, slow = Advice("dark", "stop", "Dark."), Advice("too-fast", "attention", "Fast.")
    assert most_urgent([slow, stop]) is stop
    assert most_urgent([]).severity == "good"
