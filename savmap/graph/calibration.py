"""What is wrong with the camera as unknowns of the solve: how its panoramas are stitched and cropped, how far apart its
lenses are, and how long they take to read out.

A consumer panorama is put together from two fisheye lenses, back to back. To first order, wrong angles between the
lenses and wrong principal points turn one half against the other, and a wrong focal length stretches a half away from
its axis: small turns phi = sum_j beta_j b_j(r) of each ray r, the same in every frame (additional parameters of a
self-calibrating bundle adjustment; Brown 1971). A panorama that was cropped above and below and stretched to 2:1 again
shows all elevations larger by one factor.

The lenses stand 2 to 3 cm apart, so that what one of them sees does not fit beside what the other sees. A camera's
program hides the step: it bends the pictures about the seam, so that each thing there is displaced by an angle that
depends on its distance (`BENDS`).

A rolling shutter shows a point where it was s tau later, s = -1/2..1/2 across the read-out: one unknown, tau, times the
pixel's velocity between neighbouring frames (Hedborg et al., Rolling shutter bundle adjustment, CVPR 2012). Turning
jitter faster than the frames follow one another is not modelled.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from scipy.spatial.transform import Rotation

from savmap.geometry.pinhole import rig_from_view
from savmap.graph.covariance import Covariance
from savmap.graph.measurements import Biases, ImageMeasurements, cameras_of
from savmap.types import Floats
from savmap.types.calibration import LensDistance, Shutter, Stitching, VerticalScale

LEAST_DEPTH = 0.02
LEAST_DEPTH_M = 0.2
TURNS = ("rear pitch", "rear yaw", "rear roll")
STRETCHES = ("front scale", "rear scale")
VERTICAL = "vertical scale"
SHUTTER = "read-out"
STEP_PX = 0.5
FAR_PX = 300.0
VAGUE = 0.5
"""A parameter is hardly observable where its sigma is more than this share of its prior's."""


@dataclass(frozen=True)
class Bend:
    """A way to bend the pictures. The front lens looks along a level axis, `turn_deg` to the right of the drive. From
    `half_width_deg` before the seam to as much behind it, the point of view moves from one lens to the other. The
    baseline between them lies along that axis or, `upwards`, along the vertical; the solve begins with `initial_m` of
    it, for far from the right baseline measurements at the seam seem to be outliers.

    `drive` (3, 3) of its methods are the axes that `drive_axes` gives.
    """

    name: str
    turn_deg: float
    half_width_deg: float
    upwards: bool = False
    initial_m: float = 0.0

    def axis(self, drive: Floats) -> Floats:
        """The unit direction (3,) of the front lens."""
        turn = np.radians(self.turn_deg)
        return np.asarray(np.cos(turn) * drive[0] + np.sin(turn) * drive[1])

    def baseline(self, drive: Floats) -> Floats:
        """The unit direction (3,) from the rear lens to the front one."""
        return np.asarray(drive[2] if self.upwards else self.axis(drive))

    def points_of_view(self, rays: Floats, drive: Floats) -> Floats:
        """From where (n, 3), beside the rig's centre, unit rays (n, 3) are seen, for a baseline of a metre."""
        from_seam = np.degrees(np.arcsin(np.clip(rays @ self.axis(drive), -1.0, 1.0)))
        share = np.clip(from_seam / self.half_width_deg, -1.0, 1.0) / 2
        return np.asarray(share[:, None] * self.baseline(drive))


BENDS = (
    Bend("wide bend", 0.0, 20.0, initial_m=0.0125),
    Bend("narrow bend", 0.0, 5.0, initial_m=0.0125),
    Bend("upwards", 0.0, 10.0, upwards=True),
    Bend("seam turned right", 50.0, 10.0),
    Bend("seam turned left", -50.0, 10.0),
)
"""Where a seam crosses a face beside the drive; one in between is bent like a mixture of these."""
LENS_DISTANCES = tuple(f"lens distance ({bend.name})" for bend in BENDS)


def total_baseline(parts: Floats, covariance: Floats) -> tuple[float, float]:
    """The length of the baseline that is the sum of the bends' `parts` (b,), m, and its standard deviation, by the
    parts' covariance (b, b)."""
    directions = np.array([bend.baseline(np.eye(3)) for bend in BENDS])
    total = parts @ directions
    length = float(np.linalg.norm(total))
    along = directions @ total / max(length, 1e-9)
    return length, float(np.sqrt(max(along @ covariance @ along, 0.0)))


def largest_displacement(parts: Floats) -> float:
    """The farthest, m, that the bends' `parts` (b,) of the baseline move the point of view of any level ray."""
    turns = np.radians(np.arange(360.0))
    rays = np.stack([np.cos(turns), np.sin(turns), np.zeros(len(turns))], axis=1)
    places = np.einsum("b,bni->ni", parts, np.stack([bend.points_of_view(rays, np.eye(3)) for bend in BENDS]))
    return float(np.linalg.norm(places, axis=1).max())


def drive_axes(poses: Floats, speeds: Floats) -> Floats:
    """The unit directions (3, 3) along which a camera mostly goes, across that to the right, and upwards, in the rig
    frame, from its poses world_from_rig (f, 4, 4), y up, and speeds (f, 3) m/s in the world: one for all passes, for
    the camera is one."""
    inside = np.einsum("fji,fj->fi", poses[:, :3, :3], speeds)
    along = np.linalg.eigh(inside.T @ inside)[1][:, -1]
    along *= -1.0 if along @ inside.sum(axis=0) < 0 else 1.0
    up = poses[:, 1, :3].mean(axis=0)
    up -= (up @ along) * along
    up /= np.maximum(np.linalg.norm(up), 1e-9)
    return np.stack([along, np.cross(along, up), up])


@dataclass(frozen=True, eq=False)
class Scene:
    """What n measurements show now: their points (n, 3) m in the rig frame, the camera's own speeds (n, 3) m/s and
    turning rates (n, 3) rad/s there, and its `drive` (3, 3) there (`drive_axes`)."""

    points: Floats
    speeds: Floats
    rates: Floats
    drive: Floats


@dataclass(frozen=True, eq=False)
class Lenses:
    """The views of n measurements: rig_from_view (n, 3, 3), focal lengths (n, 2) and principal points (n, 2), px."""

    mounts: Floats
    focal: Floats
    centres: Floats

    @staticmethod
    def of(measurements: ImageMeasurements) -> "Lenses":
        """The lens of each measurement."""
        cameras, mounts = cameras_of(measurements)
        return Lenses(mounts, cameras[:, [0, 1], [0, 1]], cameras[:, :2, 2])

    def rays(self, pixels: Floats) -> Floats:
        """Unit rays (n, 3) in the rig frame."""
        plane = np.concatenate([(pixels - self.centres) / self.focal, np.ones((len(pixels), 1))], axis=1)
        rays = np.einsum("nij,nj->ni", self.mounts, plane)
        unit: Floats = rays / np.linalg.norm(rays, axis=1, keepdims=True)
        return unit

    def depths(self, points: Floats) -> Floats:
        """Depths (n,) of points (n, 3) in the rig frame."""
        return np.asarray(np.einsum("ni,ni->n", self.mounts[:, :, 2], points))

    def projected(self, points: Floats) -> tuple[Floats, Floats]:
        """Pixels (n, 2) of points (n, 3) in the rig frame, and their derivatives (n, 2, 3) to these."""
        local = np.einsum("nji,nj->ni", self.mounts, points)
        depth = np.maximum(local[:, 2], LEAST_DEPTH)[:, None]
        plane = local[:, :2] / depth
        slopes = np.zeros((len(points), 2, 3))
        slopes[:, 0, 0] = slopes[:, 1, 1] = 1.0
        slopes[:, :, 2] = -plane
        slopes = (self.focal / depth)[:, :, None] * slopes @ np.swapaxes(self.mounts, 1, 2)
        return plane * self.focal + self.centres, slopes

    def nearest(self, points: Floats, pixels: Floats) -> Floats:
        """Pixels (n, 2) of points (n, 3) m that are in front of the view; the given ones for others."""
        return np.where((self.depths(points) > LEAST_DEPTH_M)[:, None], self.projected(points)[0], pixels)


@dataclass(frozen=True, eq=False)
class Distortion:
    """The distortion about n observed pixels (n, 2) for the values (p,) of a `calibration`. A measured pixel and those
    about it belong to one half."""

    lenses: Lenses
    seen: Floats
    values: Floats
    scene: Scene
    calibration: "Calibration"

    def __call__(self, pixels: Floats) -> tuple[Floats, Floats]:
        """Where pixels (n, 2) would be without it, and how they move (n, 2, p) with each parameter."""
        rays = self.lenses.rays(pixels)
        true, moves = pixels, list[Floats]()
        basis = self._turns(rays)
        if basis.shape[1]:
            turn = np.einsum("p,npi->ni", self.values[: basis.shape[1]], basis)
            straight = np.asarray(Rotation.from_rotvec(turn).apply(rays))
            true, slopes = self.lenses.projected(straight)
            moves.append(-np.einsum("nij,npj->nip", slopes, np.cross(basis, straight[:, None])))
        if self.calibration.lens_distance:
            first = basis.shape[1]
            true = true - self._parallax @ self.values[first : first + len(BENDS)]
            moves.append(self._parallax)
        if shutter := self.calibration.shutter:
            late = read_out_share(rays, self.calibration.front_deg, shutter.axis)[:, None] * self._velocities(rays)
            true = true - self.values[-1] * late
            moves.append(late[:, :, None])
        return true, np.concatenate(moves, axis=2)

    def _turns(self, rays: Floats) -> Floats:
        """Small turns (n, t, 3) of rays (n, 3) to their true directions, for each of the parameters that turn them."""
        parts, front_deg = [np.zeros((len(rays), 0, 3))], self.calibration.front_deg
        if stitching := self.calibration.stitching:
            rear = rear_share(self.lenses.rays(self.seen), front_deg, stitching.blend_deg)
            parts.append(turns(rays, rear, front_deg))
        if self.calibration.vertical:
            parts.append(lowered(rays)[:, None])
        return np.concatenate(parts, axis=1)

    @cached_property
    def _parallax(self) -> Floats:
        """How the points' pixels move (n, 2, b) with the baseline of each bend, px/m. What is seen about a point moves
        with it, and is not sheared: that is below a degree."""
        points, drive = self.scene.points, self.scene.drive
        slopes = self.lenses.projected(points)[1] * (self.lenses.depths(points) > LEAST_DEPTH_M)[:, None, None]
        rays = points / np.maximum(np.linalg.norm(points, axis=1), LEAST_DEPTH)[:, None]
        places = [bend.points_of_view(rays, drive) for bend in BENDS]
        return np.stack([-np.einsum("nij,nj->ni", slopes, place) for place in places], axis=2)

    def _velocities(self, rays: Floats) -> Floats:
        """How fast (n, 2) px/s what is seen along rays (n, 3) moves in the picture, at the depths of the points."""
        depths = self.lenses.depths(self.scene.points)
        points = (np.maximum(depths, LEAST_DEPTH_M) / np.maximum(self.lenses.depths(rays), LEAST_DEPTH))[:, None] * rays
        moving = -np.cross(self.scene.rates, points) - self.scene.speeds
        slopes = self.lenses.projected(points)[1]
        return np.asarray(np.einsum("nij,nj->ni", slopes, moving) * (depths > LEAST_DEPTH_M)[:, None])


def _axis_across(axis: Floats, rays: Floats) -> Floats:
    """Unit axes (n, 3) about which `axis` (3,) turns to rays (n, 3)."""
    across = np.cross(axis, rays)
    across /= np.maximum(np.linalg.norm(across, axis=-1), 1e-9)[:, None]
    return np.asarray(across)


def rear_share(rays: Floats, front_deg: float, blend_deg: float) -> Floats:
    """How much (n,) of what is seen along rays (n, 3) the rear lens shows, 0..1."""
    off_axis = np.arccos(np.clip(rays @ rig_from_view(front_deg, 0.0, 0.0)[:, 2], -1.0, 1.0))
    return np.clip((np.degrees(off_axis) - 90.0) / blend_deg + 0.5, 0.0, 1.0)


def turns(rays: Floats, rear: Floats, front_deg: float) -> Floats:
    """Small turns (n, 5, 3) of rays (n, 3) of the panorama to their true directions, a radian or a unit of scale."""
    rig_from_lens = rig_from_view(front_deg, 0.0, 0.0)
    ahead = rig_from_lens[:, 2]
    off_axis = np.arccos(np.clip(rays @ ahead, -1.0, 1.0))
    about = _axis_across(ahead, rays)
    halves = (rear - 0.5)[:, None, None] * rig_from_lens.T
    stretched = [((1 - rear) * off_axis)[:, None] * about, (rear * (np.pi - off_axis))[:, None] * -about]
    return np.concatenate([halves, np.stack(stretched, axis=1)], axis=1)


def lowered(rays: Floats) -> Floats:
    """Small turns (n, 3) of rays (n, 3) towards the panorama's horizon, by as much as they are above or below it."""
    about = -_axis_across(np.array([0.0, 1.0, 0.0]), rays)
    return np.asarray(np.arcsin(np.clip(-rays[:, 1], -1.0, 1.0))[:, None] * about)


def read_out_share(rays: Floats, front_deg: float, axis: str) -> Floats:
    """When (n,) rays (n, 3) are read out, -1/2..1/2 of the read-out time."""
    if axis == "rows":
        return np.arcsin(np.clip(rays[:, 1], -1.0, 1.0)) / np.pi
    longitude = np.arctan2(rays[:, 0], rays[:, 2]) - np.radians(front_deg)
    share: Floats = np.mod(longitude / np.pi + 0.5, 1.0) - 0.5
    return share


def velocities(poses: Floats, stamps_s: Floats) -> tuple[Floats, Floats]:
    """Speeds (f, 3) m/s in the world and turning rates (f, 3) rad/s in the rig frame of poses (f, 4, 4) at stamps (f,),
    in order of time; zeros where two stamps are equal."""
    count = len(poses)
    before, after = np.maximum(np.arange(count) - 1, 0), np.minimum(np.arange(count) + 1, count - 1)
    span = stamps_s[after] - stamps_s[before]
    per_second = np.where(span > 0, 1 / np.where(span > 0, span, 1.0), 0.0)[:, None]
    turned = np.swapaxes(poses[before, :3, :3], 1, 2) @ poses[after, :3, :3]
    rates: Floats = Rotation.from_matrix(turned).as_rotvec() * per_second
    return (poses[after, :3, 3] - poses[before, :3, 3]) * per_second, rates


@dataclass(frozen=True)
class Calibration:
    """Which terms are unknowns of the solve. Values are radians, fractions, metres and seconds, in the order of
    `names`. The front lens looks at longitude `front_deg` of the panorama; the lens distance does not use
    `front_deg`."""

    stitching: Stitching | None = None
    shutter: Shutter | None = None
    front_deg: float = 0.0
    vertical: VerticalScale | None = None
    lens_distance: LensDistance | None = None

    @cached_property
    def names(self) -> tuple[str, ...]:
        """The parameters (p,)."""
        stitched = (*TURNS, *STRETCHES) if self.stitching else ()
        lenses = LENS_DISTANCES if self.lens_distance else ()
        return (*stitched, *((VERTICAL,) if self.vertical else ()), *lenses, *((SHUTTER,) if self.shutter else ()))

    @cached_property
    def prior(self) -> Floats:
        """Standard deviations (p,) about 0."""
        return np.array([*self._priors()])

    @cached_property
    def initial(self) -> Floats:
        """Where the solve begins (p,): 0 but for the lens distance."""
        initial = {name: bend.initial_m for name, bend in zip(LENS_DISTANCES, BENDS, strict=True)}
        return np.array([initial.get(name, 0.0) for name in self.names])

    def _priors(self) -> Iterator[float]:
        if self.stitching:
            yield from 3 * [float(np.radians(self.stitching.turn_sigma_deg))] + 2 * [self.stitching.scale_sigma]
        if self.vertical:
            yield self.vertical.sigma
        if self.lens_distance:
            yield from len(LENS_DISTANCES) * [self.lens_distance.sigma_m]
        if self.shutter:
            yield self.shutter.sigma_s

    def with_parameters(self, measurements: ImageMeasurements) -> ImageMeasurements:
        """The measurements with the parameters as their last biases; `corrected` fills in the slopes."""
        biases, count = measurements.biases, len(self.names)
        added = len(biases.prior) + np.tile(np.arange(count), (len(measurements), 1))
        wider = Biases(
            np.concatenate([biases.indices, added], axis=1),
            np.pad(biases.slopes, ((0, 0), (0, 0), (0, count))),
            np.concatenate([biases.prior, self.prior]),
            np.pad(biases.free, (0, count), constant_values=True),
            np.pad(biases.relative, (0, count)),
        )
        return replace(measurements, biases=wider)

    def without_parameters(self, measurements: ImageMeasurements) -> ImageMeasurements:
        """The measurements without the parameters, which are their last biases."""
        biases = measurements.biases
        count, slots = (size - len(self.names) for size in (len(biases.prior), biases.indices.shape[1]))
        fewer = Biases(
            biases.indices[:, :slots],
            biases.slopes[:, :, :slots],
            biases.prior[:count],
            biases.free[:count],
            biases.relative[:count],
        )
        return replace(measurements, biases=fewer)

    def corrected(self, measurements: ImageMeasurements, values: Floats, scene: Scene) -> ImageMeasurements:
        """Measurements with these parameters corrected for `values` (p,), and their slopes to these now.

        Pixels, their covariances and the directions of other biases are moved with the picture about them: an edge's
        place is loose along it, and only there. The slopes of a measurement are those at the pixel where its point
        should be, which an edge leaves open along itself: its line turns about where it was seen.
        """
        lenses = Lenses.of(measurements)
        field = Distortion(lenses, measurements.pixels, values, scene, self)
        pixels, here = field(measurements.pixels)
        step = STEP_PX * np.eye(2)
        slopes = np.stack([field(measurements.pixels + shift)[0] - pixels for shift in step], axis=2) / STEP_PX
        offset = np.clip(lenses.nearest(scene.points, pixels) - pixels, -FAR_PX, FAR_PX)
        size = np.maximum(np.linalg.norm(offset, axis=1), STEP_PX)[:, None]
        near = field(measurements.pixels + STEP_PX * offset / size)[1]
        moves = here + (size / STEP_PX)[:, :, None] * (near - here)
        biases = measurements.biases
        all_slopes = np.concatenate([slopes @ biases.slopes[:, :, : -len(self.names)], moves], axis=2)
        return replace(
            measurements,
            pixels=pixels,
            covariances=slopes @ measurements.covariances @ np.swapaxes(slopes, 1, 2),
            biases=replace(biases, slopes=all_slopes),
        )


@dataclass(frozen=True)
class CalibrationReport:
    """Figures for the report, and lines for the user."""

    report: Mapping[str, float | str] = field(default_factory=dict)
    notes: tuple[str, ...] = ()


def calibration_report(
    term: Calibration | None, bias: Floats, covariance: Covariance, before: float, after: float
) -> CalibrationReport:
    """Values with sigmas of the parameters, which are the last of `bias` (k,), and the residuals' scale without them
    (`before`) and with them. With the lens distance, the scale without it is not known: the solve begins with one."""
    if term is None:
        return CalibrationReport()
    count = len(term.names)
    sigmas = np.sqrt(np.diag(covariance.shared))[-count:]
    report: dict[str, float | str] = {}
    lines_of_terms, vague = list[str](), list[str]()
    for name, value, sigma, prior in zip(term.names, bias[-count:], sigmas, term.prior, strict=True):
        unit, size = _unit(name)
        report[f"calibration {name}, {unit}"] = float(value * size)
        report[f"calibration {name}, sigma {unit}"] = float(sigma * size)
        lines_of_terms.append(f"{name} {value * size:+.2f} +- {sigma * size:.2f} {unit}")
        vague += [name] if sigma > VAGUE * prior else []
    scales = f"{after:.2f} with it"
    if term.lens_distance:
        at = [term.names.index(name) - count for name in LENS_DISTANCES]
        distance, sigma = total_baseline(bias[at], covariance.shared[np.ix_(at, at)])
        report |= {"calibration lens distance, cm": 100 * distance, "calibration lens distance, sigma cm": 100 * sigma}
    else:
        report["residual_scale_uncalibrated"] = before
        scales = f"{before:.2f} without, {scales}"
    lines = [f"calibration: {', '.join(lines_of_terms)}; residuals' scale {scales}"]
    if vague:
        lines.append(f"calibration: this footage hardly tells {', '.join(vague)}")
    return CalibrationReport(report, tuple(lines))


def _unit(name: str) -> tuple[str, float]:
    """Unit of a parameter in reports, and how many there are to a radian, a whole, a metre, or a second."""
    if name in TURNS:
        return "deg", float(np.degrees(1.0))
    if name in LENS_DISTANCES:
        return "cm", 1e2
    return ("ms", 1e3) if name == SHUTTER else ("percent", 1e2)
