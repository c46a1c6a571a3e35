"""Painted stripes on the floor and their corners: the smallest complete plugin."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np

import savmap.plugin as door
from savmap.plugin import Detection, Feature, Floats, RowFacts, Structure, Track, Trajectory, View, hookimpl

VIEW = "stripes"
HFOV_DEG = 90.0
SIGMA_PX = 0.7  # how far a corner of a mask is off
SAME_M = 0.5  # first corners nearer to one another along the row are of one stripe
FLOOR_M = 0.005  # how flat the floor is
LOST_M = 0.5  # a stripe whose place is not known better is left out


class StripeLimits(door.InspectionLimits):
    """Limits of an inspection."""

    width_m: door.Limit = door.Limit(
        amber=0.05, red=0.04, source="ASR A1.3: a marking is 5 cm wide or wider; not checked against its text"
    )
    """Of a stripe: a worn one is narrower."""


class Stripes:
    """Stripes that run along the aisle. Their corners are numbered over all of a row: "stripe corner 1" to "stripe corner 4" are those of
    the first, from its end at low x on the face's side, around."""

    name = "stripes"
    classes = ("stripe",)
    model = Path(__file__).parent / "model" / "stripes.onnx"
    Config = door.PluginSettings
    Limits = StripeLimits
    needs_path = True

    def __init__(self, config: door.PluginSettings) -> None:
        self.config = config

    @hookimpl
    def render_views(
        self, pass_preview: door.PassPreview, manual: Mapping[str, door.Manual], attitude: Floats | None
    ) -> door.ViewPlan:
        """Straight down: there a stripe is a rectangle in the picture too."""
        world_from_rig = pass_preview.rig_from_manhattan.T if attitude is None else attitude
        spec = door.floor_view(door.face_at(world_from_rig), HFOV_DEG, VIEW)
        return door.ViewPlan((manual[VIEW].over(spec) if VIEW in manual else spec,))

    @hookimpl
    def extract_features(self, view: View, detections: Sequence[Detection]) -> list[Feature]:
        """The four corners of each stripe that the view does not cut."""
        return [
            door.point_feature(view, detection, instance, f"corner {number}", pixel, SIGMA_PX)
            for instance, detection in enumerate(detections)
            if not door.touches_border(detection.mask)
            for number, pixel in enumerate(corners_of(detection.mask), start=1)
        ]

    @hookimpl
    def track(self, features: Sequence[Feature], facts: RowFacts, start: Trajectory) -> list[Track]:
        """A corner is at one place of the floor, in whatever frame it is seen."""
        tracks = door.tracks_on_floor(features, facts, start, "corner 1", SAME_M, level_known=False)
        return [replace(track, name=f"stripe corner {number}") for number, track in enumerate(tracks, start=1)]

    @hookimpl
    def constrain(
        self, tracks: Sequence[Track], facts: RowFacts, start: Trajectory, keys: door.KeySpace
    ) -> door.Constraints:
        """All corners are on the floor. The first one's height is a reference, so that it may fix where y = 0 is."""
        first, *others = keys.keys([track.name for track in tracks]).values()
        floor = [door.known_coordinate("y", first, 0.0, FLOOR_M, "height of stripe corner 1")]
        return door.point_constraints(
            tracks, facts, start, keys, [*floor, *(door.fixed_coordinate("y", key, 0.0, FLOOR_M) for key in others)]
        )

    @hookimpl
    def describe(self, tracks: Sequence[Track], landmarks: Mapping[str, door.Landmark]) -> list[Structure]:
        """A closed outline for each stripe."""
        return door.point_structures(tracks, landmarks, LOST_M, closed=True)

    @hookimpl
    def inspect(self, structures: Sequence[Structure], limits: StripeLimits) -> door.RowInspection:
        """Whether stripes are as wide as markings must be."""
        return door.RowInspection(tuple(width_finding(stripe, limits.width_m) for stripe in structures))

    @hookimpl
    def evaluate(self, structures: Sequence[Structure], survey: Mapping[str, Any]) -> door.Score:
        """How far corners are from the survey's: `stripes: [[corner, corner, corner, corner], ...]`, x, y, z, m."""
        return door.score_points(structures, door.surveyed_points(survey, self.name, 4), LOST_M, self.name)


def width_finding(stripe: Structure, limit: door.Limit) -> door.Finding:
    """The width of a stripe, across the aisle, with the standard deviation of two edges that share no error."""
    width = stripe.vertices[[0, 1], 2].mean() - stripe.vertices[[2, 3], 2].mean()
    sigma = np.sqrt(stripe.covariances[:, 2, 2].mean())
    finding = door.Finding(
        "narrow-stripe",
        f"width of {stripe.id}",
        subjects=(stripe.id,),
        unit="m",
        action="look whether it is worn; paint it anew",
    )
    return limit.finding(finding, door.Measured(abs(float(width)), float(sigma)))


def corners_of(mask: np.ndarray[Any, np.dtype[np.bool_]]) -> Floats:
    """The corners (4, 2) px of the rectangle around a mask: upper left, upper right, lower right, lower left."""
    rows, columns = np.nonzero(mask)
    middle, (width, height), turn = cv2.minAreaRect(np.stack([columns, rows], axis=1).astype(np.float32))
    corners = np.asarray(cv2.boxPoints((middle, (width + 1, height + 1), turn)), np.float64)
    across, along = corners @ [1, 1], corners @ [1, -1]
    return corners[[across.argmin(), along.argmax(), across.argmax(), along.argmin()]]
