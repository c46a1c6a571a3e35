"""Lamps of drawn drives, from pictures to the map: strips, joints, compact lamps, beams below, heights, lines."""

import numpy as np
import pytest

from savmap.errors import StructureError
from savmap.types import Floats
from savmap_lights.plugin import Settings

from . import drawn_ceiling as drawn


def x_of(drive: drawn.Drive) -> Floats:
    return np.array([lamp.vertices[:, 0] for lamp in drive.mapped()])


def test_strips_are_mapped_end_by_end() -> None:
    starts = np.arange(-4.0, 10.0, 1.3)
    lamps = drawn.Drive([drawn.strip(x, x + 0.8) for x in starts]).mapped()
    inside = [lamp for lamp in lamps if 0 < lamp.vertices[:, 0].mean() < 6]
    assert len(inside) == 5
    for lamp in inside:
        assert lamp.vertex_labels == ("end 0", "end 1")
        assert np.abs(starts - lamp.vertices[0, 0]).min() < 0.015
        assert np.abs(lamp.vertices[1] - lamp.vertices[0] - [0.8, 0, 0]).max() < 0.02
    assert np.abs([lamp.vertices[:, 1] - drawn.HEIGHT_M for lamp in inside]).max() < 0.01
    assert [lamp.id for lamp in lamps] == [f"light {number}" for number in range(1, len(lamps) + 1)]
    assert all(lamp.solid is not None for lamp in lamps)


def test_a_line_of_light_is_mapped_joint_by_joint() -> None:
    starts = np.arange(-4.5, 10.0, 1.5)
    lamps = drawn.Drive([drawn.strip(x, x + 1.46) for x in starts]).mapped()
    inside = [lamp for lamp in lamps if 0 < lamp.vertices[:, 0].mean() < 6]
    assert len(inside) == 4
    for lamp in inside:
        start = starts[np.argmin(np.abs(starts - lamp.vertices[0, 0]))]
        truth = [[start, drawn.HEIGHT_M, drawn.LINE_Z_M], [start + 1.46, drawn.HEIGHT_M, drawn.LINE_Z_M]]
        assert np.abs(lamp.vertices - truth).max() < 0.03


def test_a_beam_below_strips_makes_no_lamps() -> None:
    starts = [-0.5, 1.5, 3.5, 5.5]
    found = x_of(drawn.Drive([drawn.strip(x, x + 1.2) for x in starts], beams=(0.1, 4.2), faded=False))
    assert found[:, 0] == pytest.approx(starts, abs=0.02)
    assert found[:, 1] == pytest.approx(np.array(starts) + 1.2, abs=0.02)


def test_compact_lamps_are_mapped_by_their_centres() -> None:
    centres = [0.0, 1.5, 3.0, 6.0]
    drive = drawn.Drive([drawn.strip(x - 0.12, x + 0.12) for x in centres], beams=(1.1,), faded=False)
    lamps = drive.mapped()
    assert [lamp.vertex_labels for lamp in lamps] == [("centre",)] * 4
    truth = [[x, drawn.HEIGHT_M, drawn.LINE_Z_M] for x in centres]
    assert np.abs(np.concatenate([lamp.vertices for lamp in lamps]) - truth).max() < 0.015


def test_strips_across_on_one_line_keep_their_lengths() -> None:
    strips = []
    for x in (0.5, 2.1, 3.7, 5.3):
        near, far = drawn.LINE_Z_M - 0.5, drawn.LINE_Z_M + 0.5
        corners = [(x - 0.1, near), (x + 0.1, near), (x + 0.1, far), (x - 0.1, far)]
        strips.append(np.array([(a, drawn.HEIGHT_M, b) for a, b in corners]))
    lamps = drawn.Drive(strips, faded=False).mapped(Settings(line=True))
    assert len(lamps) == 4
    ends = np.array([lamp.vertices for lamp in lamps])
    assert np.abs(np.ptp(ends[:, :, 2], axis=1) - 1.0).max() < 0.03
    assert np.ptp(ends[:, 0, 2]) < 0.001
    assert np.ptp(ends[:, :, 1]) < 0.001


def test_lamps_that_hang_lower_keep_their_heights() -> None:
    heights = [6.0, 6.0, 5.85, 6.0, 6.0]
    strips = [drawn.strip(1.4 * k, 1.4 * k + 0.8, height) for k, height in enumerate(heights)]
    lamps = drawn.Drive(strips).mapped()
    assert [lamp.vertices[:, 1].mean() for lamp in lamps] == pytest.approx(heights, abs=0.02)


def test_the_line_nearest_to_the_path_is_mapped() -> None:
    starts = np.arange(0.0, 6.0, 1.5)
    lines = [[drawn.strip(x, x + 0.8) + np.array([0, 0, z]) for x in starts] for z in (0.0, 2.2, -3.0)]
    lamps = drawn.Drive([lamp for line in lines for lamp in line]).mapped()
    assert len(lamps) == len(starts)
    assert np.abs([lamp.vertices[:, 2] - drawn.LINE_Z_M for lamp in lamps]).max() < 0.01


def test_a_line_without_an_end_in_sight_is_no_lamp() -> None:
    with pytest.raises(StructureError, match="no line of lamps shows"):
        drawn.Drive([drawn.strip(-40.0, 40.0)]).found()


def test_no_lamps_is_said() -> None:
    with pytest.raises(StructureError, match="no line of lamps shows"):
        drawn.Drive([]).found()


def test_thick_compact_lamps_are_at_their_middles() -> None:
    faces = [face for x in (0.5, 2.1, 3.7, 5.3) for face in drawn.box(x - 0.2, x + 0.2, 0.1, drawn.LINE_Z_M)]
    lamps = drawn.Drive(faces, faded=False).mapped()
    assert len(lamps) == 4
    assert np.abs(np.array([lamp.vertices[0, 1] for lamp in lamps]) - drawn.HEIGHT_M).max() < 0.006


def test_thick_strips_beside_the_camera_are_at_their_middles() -> None:
    starts = np.array([0.5, 2.1, 3.7])
    faces = [face for x in starts for face in drawn.box(x, x + 1.0, 0.07, 2.4)]
    ends = np.array([lamp.vertices for lamp in drawn.Drive(faces, faded=False).mapped()])
    assert np.abs(ends[:, :, 0] - starts[:, None] - [0.0, 1.0]).max() < 0.012
    assert np.abs(ends[:, :, 1] - drawn.HEIGHT_M).max() < 0.006
