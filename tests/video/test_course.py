"""How the camera went, from drawn panoramas of a corridor: there and back, cuts, gaps, turns, standing, the wrong hand."""

from collections.abc import Sequence

import numpy as np

from savmap.types import Panorama
from savmap.video.course import Course, contradiction, warnings
from savmap.video.motion import PassWatch

HEIGHT, WIDTH = 128, 256
TEXTURE = np.random.default_rng(1).uniform(30, 220, (4, 64, 1024))
PACE_M, STEP_S, ASIDE_M, HALL_M = 0.12, 1 / 15, 1.5, 3.0


def corridor(x_m: float, turned_deg: float = 0.0, hall: int = 0) -> np.ndarray:
    """A grey panorama from x_m along a corridor with a textured wall on either hand; its centre looks along the way."""
    longitude = 2 * np.pi * ((np.arange(WIDTH) + 0.5) / WIDTH - 0.5) + np.radians(turned_deg)
    latitude = np.pi * (0.5 - (np.arange(HEIGHT) + 0.5) / HEIGHT)[:, None]
    aside = np.abs(np.sin(longitude)).clip(0.02)
    along = x_m + ASIDE_M * np.cos(longitude) / aside
    high = 1.5 + ASIDE_M / aside * np.tan(latitude)
    column = np.floor(along * 12).astype(int) % 1024
    row = np.floor(high * 12).astype(int)
    wall = TEXTURE[(2 * hall + (np.sin(longitude) > 0).astype(int)) % 4, row.clip(0, 63), column]
    return np.where((high > 0) & (high < HALL_M), wall, np.where(high > 0, 200, 60)).astype(np.uint8)


def course(pictures: Sequence[np.ndarray], stamps: Sequence[float] | None = None) -> Course:
    """A row's face is on the left of it: its +x lies ahead."""
    watch = PassWatch()
    for frame, picture in enumerate(pictures):
        stamp = frame * STEP_S if stamps is None else stamps[frame]
        watch.update(Panorama(frame, stamp, np.dstack([picture] * 3)))
    return Course(watch.steps, 0.0)


def drive(first: int = 0, count: int = 30, hall: int = 0) -> list[np.ndarray]:
    return [corridor(PACE_M * step, hall=hall) for step in range(first, first + count)]


def what(found: Course) -> list[str]:
    named = list(warnings(found))
    assert {warning.code for warning in named} <= {"camera-motion", "missing-frames"}
    return ["; ".join((warning.figure, *warning.details)) for warning in named]


def test_a_plain_drive_is_not_warned_of() -> None:
    plain = course(drive())
    assert plain.towards == 1
    assert contradiction(plain, "left") == contradiction(plain, None) == ""
    assert what(plain) == []


def test_there_and_back_is_refused_with_the_time() -> None:
    found = course([*drive(), *drive()[::-1]])
    assert "goes back the way it came at 1.9 s" in contradiction(found, "left") or "at 2.0 s" in contradiction(
        found, "left"
    )
    assert "savmap split" in contradiction(found, "left")


def test_a_short_way_back_is_warned_of() -> None:
    found = course([*drive(0, 40), *drive(34, 6)[::-1], *drive(34, 20)])
    assert contradiction(found, "left") == ""
    assert len(what(found)) == 1
    assert what(found)[0].startswith("at 2.")
    assert "the camera goes back the way it came" in what(found)[0]


def test_the_other_hand_is_refused() -> None:
    assert "not on the right" in contradiction(course(drive()), "right")
    assert "not on the left" in contradiction(course(drive()[::-1]), "left")


def test_a_cut_to_another_place_is_warned_of() -> None:
    found = course([*drive(0, 20), *drive(100, 20, hall=1)])
    assert len(what(found)) == 1
    assert "at 1.3 s; the picture changes all at once" in what(found)[0]


def carried(count: int) -> list[np.ndarray]:
    """A camera in somebody's hands: each picture is of another place, turned another way."""
    return [corridor(300 * PACE_M + 7.0 * step, 77.0 * step, hall=step % 2) for step in range(count)]


def test_a_camera_in_the_hand_before_and_after_the_drive_is_told_once_at_each_end() -> None:
    before, after = what(course([*carried(8), *drive(0, 40), *carried(9)]))
    assert before.startswith("from 0.0 s to 0.5 s; the picture changes again and again")
    assert "begin the pass after that (`start_s`), at 0.5 s or later" in before
    assert "end the pass before that (`end_s`), at 3.1 s or earlier" in after


def test_a_camera_covered_amid_the_drive_is_told_once() -> None:
    (only,) = what(course([*drive(0, 25), *carried(6), *drive(31, 25)]))
    assert only.startswith("from 1.6 s to 2.1 s; the picture changes again and again")


def test_missing_frames_are_warned_of() -> None:
    stamps = [STEP_S * step for step in (*range(20), *range(50, 70))]
    found = course([*drive(0, 20), *drive(50, 20)], stamps)
    assert what(found) == ["from 1.3 s to 3.3 s; frames are missing"]


def test_a_smeared_frame_and_a_step_of_exposure_are_no_cuts() -> None:
    pictures = drive(0, 40)
    lighter = [np.clip(picture * 1.5, 0, 255).astype(np.uint8) for picture in pictures[20:]]
    assert what(course([*pictures[:20], *lighter])) == []
    pictures[20] = np.random.default_rng(2).integers(0, 255, (HEIGHT, WIDTH)).astype(np.uint8)
    assert what(course(pictures)) == []


def test_turning_away_is_warned_of() -> None:
    turning = [corridor(30 * PACE_M, turned) for turned in range(0, 91, 6)]
    found = course([*drive(0, 30), *turning])
    (line,) = [line for line in what(found) if "turned away from the row" in line]
    assert "end the pass before that (`end_s`), at 2.5 s or earlier" in line


def test_turning_to_the_row_at_the_beginning_is_to_be_left_out() -> None:
    turning = [corridor(0.0, turned) for turned in range(96, 0, -6)]
    (line,) = [line for line in what(course([*turning, *drive(0, 40)])) if "turned away from the row" in line]
    assert "begin the pass after that (`start_s`), at 0.5 s or later" in line


def test_standing_most_of_the_time_is_warned_of() -> None:
    found = course([*drive(0, 10), *[corridor(10 * PACE_M)] * 40, *drive(10, 10)])
    assert any("the camera stands most of the pass: leave that out" in line for line in what(found))


def test_a_pause_and_repeated_frames_are_not_warned_of() -> None:
    pictures = drive(0, 30)
    assert what(course([*pictures[:15], *[pictures[15]] * 8, *pictures[15:]])) == []
    assert what(course([picture for picture in pictures for _ in (0, 1)])) == []
