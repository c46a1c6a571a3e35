"""The walk of an ordinary lens along a face, known before anything else is looked at: its path, up to scale, and its
focal length. Such a lens sees too little for a path that is found frame by frame as the drive goes."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from savmap.errors import StructureError
from savmap.geometry.cameras import Pinhole
from savmap.geometry.poses import middle_rotation
from savmap.geometry.sphere import panorama_pixels_from_rays
from savmap.graph.lens_bundle import LensPath, adjusted
from savmap.site.model import Pass
from savmap.types import Floats, Ints, MapWarning, Panorama, array_record
from savmap.video.reader import pictures, probe_clip
from savmap.vision.lens_path import Sightings, chosen, first_path, parts, turns
from savmap.vision.lens_tracks import LensFollower, LensTracks
from savmap.vision.odometry import Followed, WalkedPath

GIVEN_SIGMA, USUAL_SIGMA, RADIAL_SIGMA = 0.05, 0.1, 0.01
"""Of a focal length that was given as a field of view, and of one that was not, as a share; of the radial term."""
CALIBRATED = 1e-4
LEAST_OFF, CLEARLY = 0.035, 2.0
"""Of a focal length, as a share, and in standard deviations, by which it is clearly another than was given."""
SETTLED, MOST_ROUNDS = 0.02, 3
"""By which share a focal length may still change when lines are looked at again."""
FINE = 4096
"""Of the panorama that followed points are told in."""
LEAST_PICTURES = 5


@dataclass(frozen=True, eq=False)
@array_record
class LensWalk:
    """What is known of a pass of an ordinary lens.

    `camera`: the lens that was found; `given`: as it was given, None where it was not; `focal_sigma`: the standard
    deviation of its focal length, as a share. `frames` (f,): those of the clip that were looked at; `part` (f,): to
    which part of the path each belongs, the longest is 0; `world_from_rig` (f, 4, 4): x along the face, y up, z out of
    it, in an unknown scale. `seen_point` (n,): the points that were seen, in `seen_frame` (n,) of the clip, along
    `rays` (n, 3) in the rig frame; `points` (p, 3): where they are. `off_px`: by how many pixels the middle one of
    the sightings is off, in pictures as wide as points are followed in.
    """

    camera: Pinhole
    given: Pinhole | None
    focal_sigma: float
    frames: Ints
    part: Ints
    world_from_rig: Floats
    seen_frame: Ints
    seen_point: Ints
    rays: Floats
    points: Floats
    off_px: float

    @cached_property
    def _at(self) -> Mapping[int, int]:
        return {number: k for k, number in enumerate(self.frames.tolist())}

    def followed(self, frame: int) -> Followed:
        """The points that were followed to a frame of the clip; none where it was passed over."""
        here = self.seen_frame == frame
        pixels = panorama_pixels_from_rays(self.rays[here], FINE // 2).astype(np.float32)
        return Followed(self.seen_point[here], pixels, FINE)

    def known_at(self, frame: int) -> tuple[Floats, Floats] | None:
        """The pose (4, 4) of a frame of the clip, and the places (n, 3) of the points that are seen there; None where
        that is not known."""
        k = self._at.get(frame)
        if k is None or self.part[k]:
            return None
        return self.world_from_rig[k], self.points[self.seen_point[self.seen_frame == frame]]

    @property
    def travel(self) -> int:
        """Which way the camera goes along the face: +1 to the right as one looks at it, -1 to the left."""
        along = self.world_from_rig[self.part == 0, 0, 3]
        return int(np.sign(along[-1] - along[0]))

    @property
    def lens_line(self) -> str:
        """What the pictures tell of the lens."""
        sigma = self.camera.hfov_deg * (1 - 1 / (1 + self.focal_sigma))
        field = f"field of view {self.camera.hfov_deg:.1f} +- {sigma:.1f} degrees by the pictures"
        return field if self.given is None else f"{field}, {self.given.hfov_deg:.1f} were given"

    @property
    def warnings(self) -> tuple[MapWarning, ...]:
        """What speaks against the lens that was given."""
        off = 0.0 if self.given is None else abs(self.camera.resolution / self.given.resolution - 1)
        if off < max(LEAST_OFF, CLEARLY * self.focal_sigma):
            return ()
        line = f"{self.lens_line}: give that, or a calibration"
        return (MapWarning("bad-panorama", figure=f"{100 * off:.0f} % off", details=(line,)),)

    @property
    def world_from_rig_usual(self) -> Floats:
        """How the camera is usually turned (3, 3)."""
        return middle_rotation(self.world_from_rig[self.part == 0, :3, :3])


class LensPoints:
    """Points that were followed before, as a follower tells them."""

    def __init__(self, walk: LensWalk) -> None:
        self._walk = walk

    def update(self, panorama: Panorama) -> Followed:
        """The points that were followed to a frame; none where it was passed over."""
        return self._walk.followed(panorama.frame)

    def forget(self, numbers: Ints) -> None:
        """All points are of use."""

    def go_on(self, panorama: Panorama, followed: Followed, next_number: int) -> None:
        """Go on from a frame: nothing needs it."""


class LensWay:
    """A walk that is known, frame by frame, as odometry tells one."""

    def __init__(self, walk: LensWalk) -> None:
        self._walk, self._count = walk, 0
        self._now: tuple[Floats, Floats] | None = None

    @property
    def path(self) -> WalkedPath:
        """The path so far."""
        poses, part = np.tile(np.eye(4), (self._count, 1, 1)), np.full(self._count, -1)
        here = self._walk.frames < self._count
        numbers = self._walk.frames[here]
        poses[numbers], part[numbers] = self._walk.world_from_rig[here], self._walk.part[here]
        return WalkedPath(poses, part, np.zeros((self._count, 6)))

    @property
    def pose(self) -> Floats | None:
        """world_from_rig (4, 4) of the latest frame; None where it is not known."""
        return None if self._now is None else self._now[0]

    @property
    def part(self) -> int:
        """The part of the drive that the latest frame belongs to; -1 where its pose is not known."""
        return -1 if self._now is None else 0

    @property
    def places(self) -> Floats:
        """Where the points are (n, 3) that are seen in the latest frame."""
        return np.zeros((0, 3)) if self._now is None else self._now[1]

    def take(self, followed: Followed) -> Ints:
        """Go on to the next frame; the numbers of points that are to be followed no more: none."""
        self._now = self._walk.known_at(self._count)
        self._count += 1
        return followed.numbers[:0]


def lens_walk(row_pass: Pass) -> LensWalk | None:
    """The walk of a pass that was filmed with an ordinary lens; None of one that was not. Raises VideoError, SiteError,
    StructureError."""
    clip, section = row_pass.clip, row_pass.camera
    if section is None or section.model != "pinhole":
        return None
    info, follower = probe_clip(clip), LensFollower()
    lens = section.camera(info.width, info.height)
    for number, (_, picture) in enumerate(pictures(clip)):
        follower.update(number, picture)
    every = follower.tracks
    part = parts(every)
    tracks = every.only(part == 0)
    if len(tracks.frames) < LEAST_PICTURES or not isinstance(lens, Pinhole):
        raise StructureError(
            f"{clip.path}: the camera's path is not known: at most {len(tracks.frames)} pictures in a row lead from "
            "one to the next; film a walk along the face, more slowly, or where it is brighter"
        )
    calibrated = section.calibration is not None
    sigma = CALIBRATED if calibrated else GIVEN_SIGMA if section.hfov_deg else USUAL_SIGMA
    seen, path = settled(tracks, _of_width(lens, tracks.size[0]), sigma, CALIBRATED if calibrated else RADIAL_SIGMA)
    poses = np.tile(np.eye(4), (len(part), 1, 1))
    poses[part == 0] = path.world_from_rig
    fits = path.fits
    focal = path.focal_px * info.width / tracks.size[0]
    return LensWalk(
        camera=lens if calibrated else replace(lens, focal_px=(focal, focal), distortion=(path.radial,)),
        given=lens if calibrated or section.hfov_deg else None,
        focal_sigma=path.focal_sigma_px / path.focal_px,
        frames=every.frames,
        part=part,
        world_from_rig=poses,
        seen_frame=tracks.frames[seen.frame[fits]],
        seen_point=seen.point[fits],
        rays=path.rays[fits],
        points=path.points,
        off_px=float(np.median(path.off_px)),
    )


def settled(tracks: LensTracks, lens: Pinhole, sigma: float, radial_sigma: float) -> tuple[Sightings, LensPath]:
    """The path, and the sightings that it was found by. Where the focal length turns out another one, lines are looked
    at once more."""
    given = lens.resolution
    for _ in range(MOST_ROUNDS):
        world_from_rig, seen = turns(tracks, lens), chosen(tracks, lens)
        start, points = first_path(seen, world_from_rig, 1 / lens.resolution)
        pixels = seen.at * lens.resolution
        path = adjusted(
            seen.frame, seen.point, pixels, start, points, lens.resolution, (given, sigma * given, radial_sigma)
        )
        if abs(path.focal_px / lens.resolution - 1) < SETTLED:
            break
        lens = replace(lens, focal_px=(path.focal_px, path.focal_px))
    return seen, path


def _of_width(lens: Pinhole, width: int) -> Pinhole:
    """The same lens with pictures of another width."""
    scale = width / lens.width
    (fx, fy), (x, y) = lens.focal_px, lens.centre_px
    centre = (x + 0.5) * scale - 0.5, (y + 0.5) * scale - 0.5
    return replace(
        lens, width=width, height=round(lens.height * scale), focal_px=(fx * scale, fy * scale), centre_px=centre
    )


def with_lens(row_pass: Pass, walk: LensWalk) -> Pass:
    """The pass with the lens that the walk told."""
    section = row_pass.camera
    if section is None or section.calibration is not None:
        return row_pass
    radial = (*walk.camera.distortion, 0.0)[0]
    lens = section.model_copy(update={"hfov_deg": walk.camera.hfov_deg, "radial": radial})
    return row_pass.model_copy(update={"camera": lens})
