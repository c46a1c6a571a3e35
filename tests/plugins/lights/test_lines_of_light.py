"""Lines of lamps in space: joints, repetition, heights, ends out of sight."""

import numpy as np
import pytest

from savmap.errors import StructureError
from savmap.geometry.pinhole import project
from savmap.graph import KeySpace, camera_priors, merge, solve
from savmap.types import Feature, Structure
from savmap_lights.open_ends import UNKNOWN_M
from savmap_lights.plugin import Lights, Settings
from savmap_lights.space.ties import agreeing, point_of, unnoticed
from savmap_lights.tracking import track_lamps

from . import drawn_ceiling as drawn

LIGHTS = Lights(Settings())


def mapped(features: list[Feature], plugin: Lights = LIGHTS) -> list[Structure]:
    """The lamps of a drive whose path is known."""
    path, facts = drawn.path(), drawn.facts()
    tracks = track_lamps(features, facts, path)
    constraints = plugin.constrain(tracks, facts, path, KeySpace("lights"))
    solution = solve(merge(camera_priors(facts, path, fixed=path), constraints))
    return LIGHTS.describe(tracks, solution.landmarks_of("lights"))


def whole(lamps: list[Structure]) -> list[Structure]:
    return [lamp for lamp in lamps if lamp.covariances[:, 0, 0].max() < 1]


def test_a_line_of_light_is_mapped_joint_by_joint() -> None:
    starts = np.arange(-4.5, 10.0, 1.5)
    lamps = whole(mapped(drawn.features_of([drawn.strip(x, x + 1.46) for x in starts])))
    inside = [lamp for lamp in lamps if 0 < lamp.vertices[:, 0].mean() < 6]
    assert len(inside) == 4
    for lamp in inside:
        start = starts[np.argmin(np.abs(starts - lamp.vertices[0, 0]))]
        truth = [[start, drawn.HEIGHT_M, drawn.LINE_Z_M], [start + 1.46, drawn.HEIGHT_M, drawn.LINE_Z_M]]
        assert np.abs(lamp.vertices - truth).max() < 0.015


def test_alike_strips_are_not_shifted_by_a_pitch() -> None:
    starts = np.arange(-4.0, 10.0, 1.3)
    lamps = whole(mapped(drawn.features_of([drawn.strip(x, x + 0.8) for x in starts])))
    inside = [lamp for lamp in lamps if 0 < lamp.vertices[:, 0].mean() < 6]
    assert len(inside) == 5
    assert all(np.abs(starts - lamp.vertices[0, 0]).min() < 0.01 for lamp in inside)
    assert np.abs([lamp.vertices[:, 1] - drawn.HEIGHT_M for lamp in inside]).max() < 0.01


def test_thick_compact_lamps_are_at_their_middles() -> None:
    faces = [face for x in (0.5, 2.1, 3.7, 5.3) for face in drawn.box(x - 0.2, x + 0.2, 0.1, drawn.LINE_Z_M)]
    lamps = mapped(drawn.features_of(faces, faded=False))
    assert len(lamps) == 4
    assert np.abs(np.array([lamp.vertices[0, 1] for lamp in lamps]) - drawn.HEIGHT_M).max() < 0.006


def test_thick_strips_beside_the_camera_are_at_their_middles() -> None:
    starts = [0.5, 2.1, 3.7]
    tracks = track_lamps(
        drawn.features_of([face for x in starts for face in drawn.box(x, x + 1.0, 0.07, 2.4)], faded=False),
        drawn.facts(),
        drawn.path(),
    )
    rays = [point_of(track, drawn.facts(), drawn.path()) for track in tracks]
    truth = [[x, drawn.HEIGHT_M, 2.4] for start in starts for x in (start, start + 1.0)]
    assert (np.abs(np.array([point for point, _ in rays]) - truth).max(axis=0) < [0.012, 0.005, 0.003]).all()
    assert max(np.sqrt(covariance[2, 2]) for _, covariance in rays) < 0.0015


def test_strips_across_on_one_line_keep_their_lengths() -> None:
    strips = []
    for x in (0.5, 2.1, 3.7, 5.3):
        near, far = drawn.LINE_Z_M - 0.5, drawn.LINE_Z_M + 0.5
        corners = [(x - 0.1, near), (x + 0.1, near), (x + 0.1, far), (x - 0.1, far)]
        strips.append(np.array([(a, drawn.HEIGHT_M, b) for a, b in corners]))
    lamps = mapped(drawn.features_of(strips, faded=False), Lights(Settings(line=True)))
    assert len(lamps) == 4
    ends = np.array([lamp.vertices for lamp in lamps])
    assert np.abs(np.ptp(ends[:, :, 2], axis=1) - 1.0).max() < 0.03
    assert np.ptp(ends[:, 0, 2]) < 0.001
    assert np.ptp(ends[:, :, 1]) < 0.001


def test_a_beam_below_a_line_of_light_makes_no_lamps() -> None:
    lamps = mapped(drawn.features_of([drawn.strip(0.5, 5.5)], beams=(1.5, 3.0, 4.2)))
    assert len(lamps) == 1
    assert np.abs(lamps[0].vertices[:, 0] - [0.5, 5.5]).max() < 0.01


def test_a_line_without_an_end_in_sight_is_unknown_along() -> None:
    (lamp,) = mapped(drawn.features_of([drawn.strip(2.0, 40.0)]))
    assert lamp.vertex_labels == ("end 0", "end 1")
    assert lamp.vertices[0, 0] == pytest.approx(2.0, abs=0.02)
    assert lamp.covariances[0, 0, 0] < 0.05**2
    assert np.sqrt(lamp.covariances[1, 0, 0]) == UNKNOWN_M
    assert not LIGHTS.cross_row_landmarks([lamp])


def test_a_line_without_any_end_is_said() -> None:
    with pytest.raises(StructureError, match="no three frames show a lamp"):
        track_lamps(drawn.features_of([drawn.strip(-40.0, 40.0)]), drawn.facts(), drawn.path())


def test_a_lamp_that_hangs_lower_keeps_its_height() -> None:
    heights = [6.0, 6.0, 5.85, 6.0, 6.0]
    strips = [drawn.strip(1.4 * k, 1.4 * k + 0.8, height) for k, height in enumerate(heights)]
    lamps = whole(mapped(drawn.features_of(strips)))
    assert [lamp.vertices[:, 1].mean() for lamp in lamps] == pytest.approx(heights, abs=0.015)


def test_values_are_alike_that_agree_with_most() -> None:
    values, sigmas = np.array([6.0, 6.002, 5.999, 5.9, 6.05]), np.array([0.002, 0.002, 0.002, 0.002, 0.03])
    assert agreeing(values, sigmas).tolist() == [True, True, True, False, True]
    assert not agreeing(np.array([6.0, 6.1, 6.2, 6.3]), np.full(4, 0.002)).any()


def test_ties_are_as_loose_as_the_test_is_blind() -> None:
    vague, sharp = np.full(5, 0.03), np.full(5, 0.002)
    values = np.array([6.0, 6.0, 6.0, 6.0, 5.92])
    assert agreeing(values, vague).all()
    assert 0.02 < unnoticed(values, vague) < 0.03
    assert unnoticed(np.full(5, 6.0), vague) == 0.0
    assert unnoticed(6.0 + sharp * [1, -1, 0, 1, -1], sharp) < 0.003


def test_a_strip_with_a_hidden_end_is_as_long_as_its_likes() -> None:
    starts = np.arange(-0.5, 6.0, 1.3)
    features = drawn.features_of([drawn.strip(x, x + 0.9) for x in starts])
    hidden = [f for f in features if not (f.part.startswith("end") and _is_near(f, starts[2] + 0.9))]
    lamps = mapped(hidden)
    (lamp,) = (lamp for lamp in lamps if "ends" in lamp.attributes and abs(lamp.vertices[0, 0] - starts[2]) < 0.1)
    assert lamp.attributes["ends"] == "end 1 not seen"
    assert lamp.vertices[1, 0] == pytest.approx(starts[2] + 0.9, abs=0.02)
    assert 0.01 < np.sqrt(lamp.covariances[1, 0, 0]) < 0.1


def _is_near(feature: Feature, x: float) -> bool:
    """Whether a feature is where a place on the line of lamps shows."""
    pose = drawn.path().world_from_rig[feature.frame]
    point = (np.array([[x, drawn.HEIGHT_M, drawn.LINE_Z_M]]) - pose[:3, 3]) @ pose[:3, :3]
    pixel = project(point @ drawn.CEILING.rig_from_view, drawn.CEILING.camera)[0]
    return bool(np.linalg.norm(pixel - feature.pixels[0]) < 5)


def test_compact_lamps_are_mapped_by_their_centres() -> None:
    centres = [0.0, 1.5, 3.0, 6.0]
    lamps = mapped(drawn.features_of([drawn.strip(x - 0.12, x + 0.12) for x in centres], beams=(1.1,), faded=False))
    assert [lamp.vertex_labels for lamp in lamps] == [("centre",)] * 4
    truth = [[x, drawn.HEIGHT_M, drawn.LINE_Z_M] for x in centres]
    assert np.abs(np.concatenate([lamp.vertices for lamp in lamps]) - truth).max() < 0.015


def test_a_lamp_on_another_plane_is_mapped() -> None:
    heights = [6.0, 6.0, 5.6, 6.0, 6.0]
    strips = [drawn.strip(1.4 * k, 1.4 * k + 0.8, height) for k, height in enumerate(heights)]
    lamps = whole(mapped(drawn.features_of(strips)))
    assert [lamp.vertices[:, 1].mean() for lamp in lamps] == pytest.approx(heights, abs=0.03)
