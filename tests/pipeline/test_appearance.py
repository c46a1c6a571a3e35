"""Points of no structure are followed in the views of the face, where the site file asks for it."""

from pathlib import Path

import numpy as np

from savmap.pipeline import measure
from savmap.site.model import Site
from savmap.types import Panorama, ViewPlan, ViewSpec
from savmap.video.reader import Clip
from savmap.vision.flow import WINDOW, FlowTracker
from savmap.vision.markers import MarkerTracker
from savmap.vision.views import Renderer

FACE, CEILING = ViewSpec("face", -90.0, hfov_deg=120.0), ViewSpec("ceiling", 0.0, 80.0)


def test_only_the_views_of_the_face_are_looked_at() -> None:
    walk = measure.RowWalk([], measure.SegmenterPool([]), Renderer(), MarkerTracker([]), FlowTracker())
    aims = {"racks": ViewPlan((FACE,), np.eye(3)), "lamps": ViewPlan((CEILING,))}
    aimed = measure.PassPlan("pass 1", Clip(Path("none")), aims)
    rough = np.random.default_rng(1).integers(0, 255, (64, 128, 3)).astype(np.uint8)
    picture = np.kron(rough, np.ones((4, 4, 1), np.uint8))
    for frame in range(WINDOW):
        panorama = Panorama(frame, frame / 15, picture)
        views, _ = walk._render(panorama, aimed, measure.WalkJournal(None, "measuring", []))
        walk._follow(panorama, views, aimed)
    assert {flow.spec.name for flow in walk.flow.flows} == {"pass 1 / face"}
    assert len(walk.flow.flows[0].pixels) > 50


def test_the_site_file_has_a_switch() -> None:
    rows = {"A": {"passes": [{"video": "a.mp4"}]}}
    assert not Site.model_validate({"rows": rows}).appearance
    assert Site.model_validate({"rows": rows, "appearance": True}).appearance
