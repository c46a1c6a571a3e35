"""Features of a made-up rack as the extraction would give them, with all its faults, and the truth beside them."""

from dataclasses import dataclass, field

import numpy as np
from scipy.spatial.transform import Rotation

from savmap.geometry import pinhole
from savmap.types import Feature, Floats, FrameTable, RowFacts, ViewSpec

LONG = 200.0


@dataclass(frozen=True)
class Rack:
    """x (n, 2) of uprights, per bay the (m, 2) bottoms and tops of beams; how far behind the face the last of both lie; metres."""

    uprights: Floats
    beams: tuple[Floats, ...]
    height: float
    behind: float = 0.0

    @property
    def counts(self) -> list[int]:
        return [len(levels) for levels in self.beams]


@dataclass(frozen=True)
class Faults:
    """Rates and sizes of what goes wrong (probabilities a thing and frame; pixels; run lengths in frames)."""

    noise_px: float = 0.5
    miss_upright: float = 0.08
    miss_beam: float = 0.15
    run: float = 2.5
    duplicate: float = 0.02
    wide: float = 0.1
    wide_px: float = 4.0
    false_upright: float = 0.1
    false_beam: float = 0.3
    rear: float = 0.1
    behind: float = 0.6
    sway_deg: float = 1.0
    attitude_deg: float = 0.7


@dataclass(frozen=True)
class Pass:
    """One drive along the row: frames a second, mean speed m/s, distance and height of the camera, +1 or -1."""

    rate: float = 6.0
    speed: float = 0.8
    distance: float = 1.8
    height: float = 3.0
    direction: int = 1
    margin: float = 1.0
    weave: float = 0.2
    uneven: float = 0.6
    pause: int = 0


@dataclass(frozen=True)
class Footage:
    """Features and facts of a row, the attitudes a program might know (n, 3, 3), true poses (n, 4, 4), and the rack.

    truth: for each feature (by id) which upright or (bay, beam) it really shows; None for a false one.
    """

    features: list[Feature]
    facts: RowFacts
    attitudes: Floats
    world_from_rig: Floats
    rack: Rack
    truth: dict[int, tuple[int, ...] | None] = field(default_factory=dict)


def random_rack(rng: np.random.Generator, sections: int, levels: tuple[int, int] = (3, 8), bridge: bool = True) -> Rack:
    """A rack with bays 2.5 to 4 m wide; beams 0.5 to 1.6 m apart, now and then a pair 0.3 m apart."""
    width = rng.uniform(0.07, 0.13)
    clear = rng.choice([rng.uniform(2.4, 2.9), rng.uniform(3.2, 3.9)], size=sections)
    starts = np.concatenate([[0.0], np.cumsum(clear + width)])
    thickness = rng.uniform(0.08, 0.14)
    tunnel = sections // 2 if bridge and sections > 2 else -1
    beams = tuple(_beams(rng, levels, thickness, number == tunnel) for number in range(sections))
    return Rack(
        np.column_stack([starts, starts + width]), beams, max(6.0, *(float(b.max(initial=0.0)) + 0.2 for b in beams))
    )


def _beams(rng: np.random.Generator, levels: tuple[int, int], thickness: float, tunnel: bool) -> Floats:
    count = int(rng.integers(levels[0], levels[1] + 1))
    room = 6.6 / count
    gaps = np.clip(rng.uniform(0.6, 1.3, count) * room, 0.5, 2.0)
    if count > 4 and rng.random() < 0.4:
        gaps[int(rng.integers(1, count))] = 0.3
    bottoms = rng.uniform(0.1, 0.4) + np.concatenate([[0.0], np.cumsum(gaps[1:])])
    bottoms = bottoms[bottoms < 6.9]
    if tunnel:
        bottoms = 4.0 + np.arange(rng.integers(2, 4)) * rng.uniform(0.8, 1.2)
    return np.column_stack([bottoms, bottoms + thickness])


def footage(
    rack: Rack,
    rng: np.random.Generator,
    passes: tuple[Pass, ...] = (Pass(),),
    faults: Faults | None = None,
    view: ViewSpec | None = None,
    known_travel: bool = True,
) -> Footage:
    """Drive past a rack and observe it."""
    faults = faults or Faults()
    view = view or ViewSpec("shelf", 87.0, 2.0, 0.0, _field_of_view(rack, passes))
    poses = [_path(rack, one, rng, faults, view) for one in passes]
    world_from_rig = np.concatenate(poses)
    names = tuple(f"pass {k + 1}" for k, part in enumerate(poses) for _ in part)
    stamps = np.concatenate([np.arange(len(part)) / one.rate for part, one in zip(poses, passes, strict=True)])
    travel = {f"pass {k + 1}": one.direction if known_travel else 0 for k, one in enumerate(passes)}
    observer = _Observer(rack, rng, faults, view)
    features = [feature for frame, pose in enumerate(world_from_rig) for feature in observer.frame(frame, pose)]
    wrong = Rotation.from_rotvec(
        np.radians(faults.attitude_deg) * rng.normal(size=(len(world_from_rig), 3))
    ).as_matrix()
    facts = RowFacts("A", FrameTable(stamps, names), {view.name: view}, travel)
    return Footage(features, facts, wrong @ world_from_rig[:, :3, :3], world_from_rig, rack, observer.truth)


def _field_of_view(rack: Rack, passes: tuple[Pass, ...]) -> float:
    """The smallest angle that shows the face's whole height through all passes."""
    tangent = max(max(rack.height - one.height, one.height) / one.distance / (1 - one.weave / 2) for one in passes)
    return float(np.clip(np.degrees(2 * np.arctan(1.1 * tangent * 640 / 480)), 100, 164))


def _smooth(rng: np.random.Generator, count: int, period: float) -> Floats:
    phase, time = rng.uniform(0, 2 * np.pi, 3), np.arange(count)
    waves = [np.sin(2 * np.pi * time / (period * f) + phase[k]) / 2 for k, f in enumerate((1.0, 0.53, 2.7))]
    return np.sum(waves, axis=0)


def _path(rack: Rack, one: Pass, rng: np.random.Generator, faults: Faults, view: ViewSpec) -> Floats:
    length = rack.uprights[-1, 1] + 2 * one.margin
    usual = int(np.ceil(length / one.speed * one.rate)) + 1
    speed = np.clip(1 + one.uneven * _smooth(rng, 4 * usual, 5 * one.rate), 0.3, 2.0) * one.speed / one.rate
    if one.pause:
        speed[usual // 2 : usual // 2 + one.pause] = 0.0
    along = np.cumsum(speed)
    x = along[along <= length] - one.margin
    x = x if one.direction > 0 else x[::-1]
    count = len(x)
    distance = one.distance * (1 + one.weave * _smooth(rng, count, 9 * one.rate))
    height = one.height + 0.03 * _smooth(rng, count, 2 * one.rate)
    facing = np.diag([1.0, -1.0, -1.0]) @ pinhole.rig_from_view(90.0, 0.0, 0.0).T
    angles = np.radians(faults.sway_deg) * np.stack(
        [_smooth(rng, count, p * one.rate) for p in (1.5, 4.0, 2.1)], axis=1
    )
    poses = np.tile(np.eye(4), (count, 1, 1))
    poses[:, :3, :3] = Rotation.from_rotvec(angles).as_matrix() @ facing
    poses[:, :3, 3] = np.column_stack([x, height, distance])
    return poses


class _Observer:
    def __init__(self, rack: Rack, rng: np.random.Generator, faults: Faults, view: ViewSpec) -> None:
        self.rack, self.rng, self.faults, self.view = rack, rng, faults, view
        self.missing: dict[tuple[int, ...], bool] = {}
        self.truth: dict[int, tuple[int, ...] | None] = {}
        inverse = np.linalg.inv(view.camera).T
        corners = np.array(
            [[0, 0, 1], [0, view.height - 1, 1], [view.width - 1, view.height - 1, 1], [view.width - 1, 0, 1]]
        )
        rays = corners @ inverse
        self.borders = np.array([*(np.cross(rays[k], rays[k - 1]) for k in range(4)), [0.0, 0.0, 1.0]])
        self.goods = [
            (float(rng.uniform(0, rack.uprights[-1, 1])), float(rng.uniform(0.3, 6.0)), float(rng.uniform(0.6, 1.5)))
            for _ in range(4 * len(rack.beams))
        ]

    def frame(self, frame: int, pose: Floats) -> list[Feature]:
        """All features of one frame."""
        uprights = self._uprights(pose)
        features = []
        for number, (_, lines, covariance, truth) in enumerate(uprights):
            for part, ends in zip(("left", "right"), lines, strict=True):
                feature = Feature(frame, self.view.name, "upright", part, number, ends, covariance, "y")
                self.truth[id(feature)] = truth
                features.append(feature)
        for number, (lines, truth) in enumerate(self._beams(pose)):
            features += self._beam(frame, number, lines, truth, uprights)
        return features

    def _skip(self, key: tuple[int, ...], rate: float) -> bool:
        run = self.faults.run
        stay = 1 - 1 / run if self.missing.get(key) else 1 - min(rate / run / max(1 - rate, 0.01), 1.0)
        state = bool(self.missing.get(key)) if self.rng.random() < stay else not self.missing.get(key)
        self.missing[key] = state
        return state

    def _line(self, pose: Floats, a: Floats, b: Floats) -> Floats | None:
        """The visible part (2, 2) of a straight edge from a to b, cut at the view's borders; None if less than 12 px."""
        ends = (np.stack([a, b]) - pose[:3, 3]) @ (pose[:3, :3] @ self.view.rig_from_view)
        sides = ends @ self.borders.T
        low, high = 0.0, 1.0
        for start, end in sides.T.tolist():
            if start < 0 and end < 0:
                return None
            if start < 0:
                low = max(low, start / (start - end))
            elif end < 0:
                high = min(high, start / (start - end))
        pixels = pinhole.project(ends[0] + np.array([[low], [high]]) * (ends[1] - ends[0]), self.view.camera)
        return pixels if low < high and np.hypot(*(pixels[1] - pixels[0])) >= 12 else None

    def _noisy(self, line: Floats, offset: float) -> Floats:
        """A line moved across itself by `offset` and noise that depends on its length."""
        along = np.diff(line, axis=0)[0]
        normal = np.array([-along[1], along[0]]) / np.linalg.norm(along)
        amount = offset + self.rng.normal(0, self.faults.noise_px) + self.rng.normal(0, self.faults.noise_px / 2, 2)
        return line + amount[:, None] * normal

    def _uprights(self, pose: Floats) -> list[tuple[float, tuple[Floats, Floats], Floats, tuple[int, ...] | None]]:
        wanted: list[tuple[Floats, float, float, tuple[int, ...] | None, float]] = [
            (edges, -self.rack.behind * (k == len(self.rack.beams)), self.faults.miss_upright, (k,), 0.0)
            for k, edges in enumerate(self.rack.uprights)
        ]
        wanted += [(edges, -1.1, 1 - self.faults.rear, None, 0.0) for edges in self.rack.uprights]
        if self.rng.random() < self.faults.false_upright:
            x = self.rng.uniform(-1, 1) * 5 + pose[0, 3]
            wanted.append((np.array([x, x + 0.1]), float(self.rng.uniform(-1, 0.0)), 0.0, None, 0.0))
        wanted += [
            (edges + self.rng.uniform(0.06, 0.15), 0.0, 0.0, None, 0.0)
            for edges in self.rack.uprights
            if self.rng.random() < self.faults.duplicate
        ]
        found = []
        for index, (edges, z, miss, truth, _) in enumerate(wanted):
            skipped = self._skip((0, index), miss) if truth is not None else self.rng.random() < miss
            lines = [self._line(pose, np.array([x, 0.0, z]), np.array([x, self.rack.height, z])) for x in edges]
            if skipped or lines[0] is None or lines[1] is None or np.ptp(lines[0][:, 1]) < self.view.height * 0.45:
                continue
            wide = self.faults.wide_px * (self.rng.random() < self.faults.wide)
            left = self._to_borders(self._noisy(lines[0][np.argsort(lines[0][:, 1])], wide))
            right = self._to_borders(self._noisy(lines[1][np.argsort(lines[1][:, 1])], -wide))
            found.append((float(left[:, 0].mean()), (left, right), self._covariance(left), truth))
        return sorted(found, key=lambda item: item[0])

    def _to_borders(self, line: Floats) -> Floats:
        slope = (line[1, 0] - line[0, 0]) / (line[1, 1] - line[0, 1])
        rows = np.array([0.0, self.view.height - 1])
        return np.column_stack([line[0, 0] + slope * (rows - line[0, 1]), rows])

    def _covariance(self, line: Floats) -> Floats:
        along = np.diff(line, axis=0)[0] / np.linalg.norm(np.diff(line, axis=0))
        across = np.array([-along[1], along[0]])
        one = LONG**2 * np.outer(along, along) + max(self.faults.noise_px, 0.3) ** 2 * np.outer(across, across)
        return np.stack([one, one])

    def _beams(self, pose: Floats) -> list[tuple[tuple[Floats, Floats], tuple[int, ...] | None]]:
        x = self.rack.uprights
        found = []
        for section, levels in enumerate(self.rack.beams):
            for beam, y in enumerate(levels):
                rate = self.faults.miss_beam
                if not self._skip((1, section, beam), rate):
                    depth = self.rack.behind * (section == len(self.rack.beams) - 1)
                    found.append((y, (x[section, 1], x[section + 1, 0]), -depth, (section, beam)))
                if self.rng.random() < self.faults.rear:
                    found.append((y, (x[section, 1], x[section + 1, 0]), -1.1, None))
                if self.rng.random() < self.faults.duplicate:
                    found.append((y - self.rng.uniform(0.05, 0.12), (x[section, 1], x[section + 1, 0]), 0.0, None))
            if len(levels) and levels[0, 0] > 3:
                for height in (1.3, 1.9, 2.6, 3.1):
                    if self.rng.random() < self.faults.behind:
                        low = np.array([height, height + np.ptp(levels[0])])
                        found.append((low, (x[section, 1] - 2, x[section + 1, 0] + 2), -2.5, None))
        for start, y, length in self.goods:
            if self.rng.random() < self.faults.false_beam / 4:
                found.append((np.array([y, y + 0.1]), (start, start + length), 0.0, None))
        lines = []
        for y, (a, b), z, truth in found:
            pair = [self._line(pose, np.array([a, h, z]), np.array([b, h, z])) for h in y]
            if pair[0] is not None and pair[1] is not None and np.ptp(pair[0][:, 0]) > 25:
                wide = self.faults.wide_px * (self.rng.random() < self.faults.wide)
                lower, upper = (
                    self._noisy(line[np.argsort(line[:, 0])], w) for line, w in zip(pair, (wide, 0.0), strict=True)
                )
                lines.append(((lower, upper), truth))
        return lines

    def _beam(
        self, frame: int, number: int, lines: tuple[Floats, Floats], truth: tuple[int, ...] | None, uprights: list
    ) -> list[Feature]:
        neighbours, inner = self._bounds(lines[0], uprights)
        features = []
        for edge, line in zip(("lower", "upper"), lines, strict=True):
            ends = self._extended(line, inner)
            features.append(
                Feature(
                    frame,
                    self.view.name,
                    "beam",
                    edge,
                    number,
                    ends,
                    self._covariance(ends),
                    "x",
                    score=float(min(1.0, np.ptp(line[:, 0]) / max(np.ptp(ends[:, 0]), 1.0))),
                    neighbours=neighbours,
                )
            )
            for side, place in zip(("left", "right"), ends, strict=True):
                if side in neighbours:
                    beyond = abs(place[0] - line[:, 0].mean()) / np.ptp(line[:, 0])
                    spread = np.eye(2)[None] * max(self.faults.noise_px, 0.3) ** 2 * (1 + beyond**2 / 2)
                    part = f"{edge} {side}"
                    features.append(
                        Feature(frame, self.view.name, "beam", part, number, place[None], spread, neighbours=neighbours)
                    )
        for feature in features:
            self.truth[id(feature)] = truth
        return features

    def _bounds(self, line: Floats, uprights: list) -> tuple[dict[str, int], list[Floats | None]]:
        """The detected uprights on either side of a mask, with half an upright's width of play, and their inner edges."""
        neighbours: dict[str, int] = {}
        inner: list[Floats | None] = [None, None]
        for number, (_, (_, right), _, _) in enumerate(uprights):
            if _column(right, line[0, 1]) < line[0, 0] + 12:
                neighbours["left"], inner[0] = number, right
        for number, (_, (left, _), _, _) in reversed(list(enumerate(uprights))):
            if _column(left, line[1, 1]) > line[1, 0] - 12:
                neighbours["right"], inner[1] = number, left
        return neighbours, inner

    def _extended(self, line: Floats, inner: list[Floats | None]) -> Floats:
        ends = line.copy()
        slope = (line[1, 1] - line[0, 1]) / (line[1, 0] - line[0, 0])
        for end, bound in enumerate(inner):
            if bound is not None:
                x = _column(bound, line[end, 1])
                for _ in range(3):
                    y = line[0, 1] + slope * (x - line[0, 0])
                    x = _column(bound, y)
                ends[end] = (x, line[0, 1] + slope * (x - line[0, 0]))
        return ends


def _column(line: Floats, row: float) -> float:
    """Where a steep line crosses a row of pixels."""
    return float(line[0, 0] + (line[1, 0] - line[0, 0]) * (row - line[0, 1]) / (line[1, 1] - line[0, 1]))
