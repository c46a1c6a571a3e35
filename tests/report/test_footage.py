"""Footage with the wireframe over it: the worst places, seen from the nearest still, with lines where the footage shows the things."""

import base64
from dataclasses import replace

import cv2
import numpy as np
import pytest
from made_up_map import row
from made_up_page import report

from savmap.geometry import sphere
from savmap.report.page import page_text
from savmap.report.page.footage import HEIGHT, WIDTH, WORST, aimed, footage_views
from savmap.types import Doubt, Floats, RowMap, Score, Still, Trajectory, Verdict

BAR = "section 1 / bar 2"
COS, SIN = np.cos(0.45), np.sin(0.45)
TURN = np.array([[COS, 0, SIN], [0, -1, 0], [SIN, 0, -COS]])


def facing() -> RowMap:
    """A row whose camera looks at it, upright, a little askew."""
    known = row()
    poses = known.trajectory.world_from_rig.copy()
    poses[:, :3, :3] = TURN
    return replace(known, trajectory=Trajectory(known.trajectory.frames, poses))


def panorama(own: RowMap, frame: int, height: int = 256) -> Still:
    """What the camera sees there: the bar white, all else dark."""
    pose = own.trajectory.world_from_rig[frame]
    columns, rows = np.meshgrid(np.arange(2 * height), np.arange(height))
    world = sphere.rays_from_panorama_pixels(np.stack([columns, rows], -1).astype(float), height) @ pose[:3, :3].T
    with np.errstate(divide="ignore", invalid="ignore"):
        at = pose[:2, 3] - world[..., :2] * (pose[2, 3] / world[..., 2])[..., None]
    bar = (world[..., 2] < 0) & (abs(at[..., 0] - 1.45) < 1.35) & (abs(at[..., 1] - 4.05) < 0.15)
    image = np.where(bar[..., None], 250, 20).astype(np.uint8).repeat(3, axis=2)
    return Still(frame, np.asarray(cv2.imencode(".png", image)[1], np.uint8).ravel())


def test_lines_lie_over_what_the_footage_shows() -> None:
    own = facing()
    (figure,) = footage_views(own, [panorama(own, frame) for frame in (0, 10, 19)], None, "row-A")
    assert figure.backdrop is not None
    shown = base64.b64decode(figure.backdrop.href.split(",")[1])
    image = cv2.imdecode(np.frombuffer(shown, np.uint8), cv2.IMREAD_GRAYSCALE)
    assert image.shape == (HEIGHT, WIDTH)
    rows, columns = np.nonzero(image > 128)
    assert abs(columns.mean() - WIDTH / 2) < 15
    assert abs(rows.mean() - HEIGHT / 2) < 15
    (worst,) = next(layer for layer in figure.layers if layer.style == WORST).shapes
    assert worst.hint == BAR
    starts = [part.split("l")[0].split("h")[0].split("v")[0].split() for part in worst.path.split("M")[1:]]
    corners = np.array(starts, float)
    assert abs(corners[:, 0].min() - columns.min()) < 8
    assert abs(corners[:, 1].mean() - rows.mean()) < 8


def test_worst_places_are_doubts_then_errors_then_support() -> None:
    own = facing()
    stills = [panorama(own, 10)]

    def why(of: RowMap, score: Score | None = None) -> list[str]:
        return [figure.note for figure in footage_views(of, stills, score, "a")]

    named = Verdict(tuple(Doubt("shape", "odd", (name,)) for name in ("post 1", "post 2", BAR)))
    assert why(replace(own, verdict=named)) == ["shape: odd", "shape: odd"]
    trusted = replace(own, verdict=Verdict())
    assert why(trusted, Score(deviations={"post 1": 0.01, BAR: 0.02})) == ["the furthest off the survey: 2.00 cm"]
    assert why(trusted, Score(deviations={"post 1": np.inf})) == ["the furthest off the survey: not in it at all"]
    assert why(trusted) == ["seen by the fewest of the frames that should show it: 80 %"]
    assert why(replace(trusted, structures={})) == []
    assert not list(footage_views(own, [], None, "a"))


@pytest.mark.parametrize("target", [(0.0, 1.5, 0.0), (3.0, 4.0, 0.0), (0.0, 9.0, 1.6)])
def test_views_are_aimed_and_upright(target: tuple[float, float, float]) -> None:
    pose: Floats = facing().trajectory.world_from_rig[0]
    spec = aimed(pose, np.array(target))
    ahead = spec.rig_from_view[:, 2] @ pose[:3, :3].T
    assert np.allclose(np.cross(ahead, np.array(target) - pose[:3, 3]), 0, atol=1e-9)
    right = spec.rig_from_view[:, 0] @ pose[:3, :3].T
    assert abs(right[1]) < 1e-9


def test_page_shows_them_and_links_to_the_viewer() -> None:
    own = facing()
    shown = replace(report(["A", "B"], placed=False), stills={"A": (panorama(own, 10),)})
    shown = replace(shown, site_map=replace(shown.site_map, rows={"A": own}), drawings={"A": []}, viewer="view.html")
    text = page_text(shown)
    assert "footage at " in text
    assert '<a href="view.html">Viewer</a>' in text
