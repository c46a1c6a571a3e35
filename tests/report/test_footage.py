"""Footage with the wireframe over it: the right place of the right frame, and lines where the map has them."""

import base64
import re
from dataclasses import replace

import cv2
import numpy as np

from savmap.geometry.sphere import panorama_pixels_from_rays
from savmap.report.page import Report, page_text
from savmap.report.page.footage import HEIGHT_PX, SHOWN, WARNED, WIDTH_PX, footage_views, looking_at
from savmap.types import Floats, FrameTable, MapWarning, RowMap, SiteMap, Still, Structure, Trajectory, Verdict

HEIGHT = 512
BAR = np.array([[-1.0, 2, 0], [1, 2, 0]])
POST = np.array([[3.0, 0.5, 0], [3, 3.5, 0]])
FACING = np.diag([1.0, -1.0, -1.0])
"""world_from_rig of a camera that looks at the face, upright."""


def structure(name: str, ends: Floats, support: float) -> Structure:
    labels = (f"{name} / a", f"{name} / b")
    return Structure(
        name, "bar", ends, np.tile(1e-6 * np.eye(3), (2, 1, 1)), labels, np.array([[0, 1]]), {"support": support}
    )


def row(verdict: Verdict) -> RowMap:
    poses = np.tile(np.eye(4), (2, 1, 1))
    poses[:, :3, :3] = FACING
    poses[:, :3, 3] = [[0, 2, 2], [3, 2, 2]]
    things = (structure("bar", BAR, 0.9), structure("post", POST, 0.4))
    table = FrameTable(np.array([0.0, 1.5]), ("there", "there"))
    return RowMap("A", table, {}, Trajectory(np.arange(2), poses), {"things": things}, (), verdict=verdict)


def still(frame: int, grey: int) -> Still:
    panorama = np.full((HEIGHT, 2 * HEIGHT, 3), grey, np.uint8)
    return Still(frame, cv2.imencode(".jpg", panorama)[1].ravel())


STILLS = (still(0, 60), still(1, 200))


def picture(uri: str) -> np.ndarray:
    coded = np.frombuffer(base64.b64decode(uri.partition(",")[2]), np.uint8)
    return cv2.cvtColor(cv2.imdecode(coded, cv2.IMREAD_COLOR), cv2.COLOR_BGR2RGB)


def reddish(seen: np.ndarray) -> np.ndarray:
    """Where the marked line is."""
    return seen[..., 0].astype(int) - seen[..., 2] > (WARNED[0] - WARNED[2]) / 3


def test_warning_is_shown_in_the_nearest_frame_with_its_structure_marked() -> None:
    (view, weakest) = footage_views(row(Verdict((MapWarning("uncertain-element", ("post",)),))), STILLS)
    assert (view.what, view.place) == (MapWarning("uncertain-element", ("post",)).line, "there, 1.5 s, frame 1")
    assert weakest.what == "bar: supported by 90% of the frames"
    seen = picture(view.picture)
    assert seen.shape == (HEIGHT_PX, WIDTH_PX, 3)
    assert abs(int(np.median(seen)) - 200) < 5, "the second still"
    marked = reddish(seen)
    rows, columns = np.nonzero(marked)
    assert abs(columns.mean() - WIDTH_PX / 2) < 3, "the post stands in the middle"
    assert np.ptp(columns) < 6
    assert np.ptp(rows) > HEIGHT_PX / 2


def test_picture_shows_the_panorama_that_way() -> None:
    """A spot of the panorama is where the camera's pose says."""
    spot = np.array([0.4, 2.3, 0.0])
    panorama = np.zeros((HEIGHT, 2 * HEIGHT, 3), np.uint8)
    u, v = panorama_pixels_from_rays(FACING.T @ (spot - [0, 2, 2]), HEIGHT)
    cv2.circle(panorama, (round(float(u)), round(float(v))), 3, (255, 255, 255), -1)
    made = Still(0, cv2.imencode(".png", panorama)[1].ravel())
    plain = row(Verdict((MapWarning("camera-motion", place=(0.4, 2.3, 0.0)),)))
    (view, *_) = footage_views(replace(plain, structures={"things": ()}), (made,))
    rows, columns = np.nonzero(picture(view.picture).sum(axis=2) > 380)
    assert (abs(columns.mean() - (WIDTH_PX - 1) / 2), abs(rows.mean() - (HEIGHT_PX - 1) / 2)) < (2, 2)


def test_trusted_rows_show_their_weakest_structures() -> None:
    views = footage_views(row(Verdict()), STILLS)
    assert [view.what.partition(":")[0] for view in views] == ["post", "bar"]
    shown = reddish(picture(views[1].picture))
    assert shown.sum() > 50
    assert tuple(SHOWN) != tuple(WARNED)


def test_equal_ids_of_two_plugins_are_both_marked() -> None:
    made = row(Verdict((MapWarning("uncertain-element", ("post",)),)))
    twin = structure("post", BAR - np.array([1.0, 0, 0]), 0.9)
    made = replace(made, structures={"others": (twin,), **made.structures})
    (view, weakest) = footage_views(made, STILLS)
    assert view.what == MapWarning("uncertain-element", ("post",)).line
    assert view.place == "there, 0.0 s, frame 0", "the nearest to the middle of both"
    assert weakest.what == "bar: supported by 90% of the frames"


def test_weakest_is_marked_without_its_namesake() -> None:
    made = row(Verdict())
    twin = replace(made.structures["things"][1], id="bar", attributes={"support": 0.1})
    made = replace(made, structures={"others": (twin,), "things": made.structures["things"][:1]})
    views = footage_views(made, STILLS)
    assert [view.what.partition(" by ")[2] for view in views] == ["10% of the frames", "90% of the frames"]


def test_rows_without_stills_have_no_footage() -> None:
    assert footage_views(row(Verdict()), ()) == ()
    assert footage_views(row(Verdict()), (Still(7, STILLS[0].picture),)) == (), "a frame that was not located"


def test_view_straight_up_has_axes() -> None:
    for target in ([0.0, 9, 0], [0, -9, 0], [1, 2, -3]):
        turn = looking_at(np.zeros(3), np.array(target, float))
        np.testing.assert_allclose(turn.T @ turn, np.eye(3), atol=1e-12)
        assert np.linalg.det(turn) > 0


def test_page_shows_footage_and_escapes_what_it_is_about() -> None:
    verdict = Verdict((MapWarning("uncertain-element", ("post",)),))
    site = SiteMap({"A": row(verdict)}, {})
    page = page_text(Report(site, {"A": ()}, stills={"A": STILLS}))
    assert len(re.findall(r'<img src="data:image/jpeg', page)) == 2
    assert "<b>" not in page
