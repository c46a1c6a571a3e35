"""Markers on their way through a row: seen as frames are walked through, noted when they were not."""

from pathlib import Path

import numpy as np

from savmap.graph import KnownMarker, References, camera_priors
from savmap.pipeline import measure
from savmap.pipeline.records import LocatedRow, RowMeasurements, RowRequest
from savmap.pipeline.row import marker_constraints
from savmap.site.model import Site
from savmap.site.preflight import tells_scale
from savmap.types import FrameTable, RowFacts, Trajectory
from savmap.video.clip import Clip
from savmap.vision.flow import NullFlowTracker
from savmap.vision.markers import MarkerTracker, MarkerTracks
from savmap.vision.views import Renderer

from ..vision.test_markers import HEIGHT, TAG, corners_at, marked

MARKER = KnownMarker("tag36h11", 7, 0.2, 0.0005)


def test_every_frame_that_is_walked_through_is_looked_at() -> None:
    walk = measure.RowWalk(
        [], measure.SegmenterPool([]), Renderer(), MarkerTracker([("tag36h11", 7)]), NullFlowTracker()
    )
    aimed = measure.PassPlan("pass 1", Clip(Path("none")), {})
    for frame in range(3):
        panorama = marked(frame, HEIGHT, corners_at(8 + frame, 40.0, 0.0), TAG, np.random.default_rng(1))
        walk._follow(panorama, [], aimed)
    assert walk.markers.marks.tracks["tag36h11 7"][0].frames.tolist() == [0, 1, 2]


def test_one_that_was_not_seen_is_noted() -> None:
    facts = RowFacts("A", FrameTable(np.arange(3.0), ("pass 1",) * 3), {}, {})
    start = Trajectory(np.arange(3), np.tile(np.eye(4), (3, 1, 1)))
    references = References(markers=(MARKER,))
    seen = RowMeasurements(facts, {}, {}, frozenset(), (), MarkerTracks({}, {}))
    request = RowRequest("A", (), (), references)
    row = LocatedRow(request, seen, start, camera_priors(facts, start, references))
    found, notes = marker_constraints(row)
    assert not found
    assert notes == ["row A: marker tag36h11 7 was not seen well enough; it is not used"]


def test_a_marker_may_be_the_only_scale() -> None:
    marker = {"dictionary": "tag36h11", "id": 7, "size_m": 0.2}
    content = {"references": {"markers": [marker]}, "rows": {"A": {"passes": [{"video": "a.mp4"}]}}}
    assert tells_scale(Site.model_validate(content), "A", ())
