"""The cart's drive: along one straight line, or along a path with corners, stops and turning back.

World: x along the aisle, y up, z out of the first row's face. The rig's frame is x right, y down, z forward.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from savmap.geometry.pinhole import rig_from_view
from savmap.lab.sim.scene.files import Cart, CartPath
from savmap.types import Floats

_STEP_M = 0.01
_SLOWEST = 0.05
_TURN_BACK = np.cos(np.radians(170))
_WAVES_M = 15.0


@dataclass(frozen=True, eq=False)
class Drive:
    """The cart's drive: `stamps_s` (n,), `origins` (n, 3) m and `world_from_rig` (n, 3, 3)."""

    stamps_s: Floats
    origins: Floats
    world_from_rig: Floats


def drive(cart: Cart, seed: int) -> Drive:
    """Poses of the panorama's rig along the drive. Without sway, weave, bounce and tilt it follows the line or path."""
    rng = np.random.default_rng([seed, 3])
    path = course(cart, rng)
    sway, yaw, bounce, pitch, roll = (_wander(path.share, rng) for _ in range(5))
    origins = np.stack([path.ground[:, 0], cart.height + cart.bounce * bounce, path.ground[:, 1]], axis=1)
    levels = [world_from_level(np.array([x, 0.0, z])) for x, z in path.facing]
    origins += cart.sway * sway[:, None] * np.stack([level[:, 0] for level in levels])
    mount = rig_from_view(cart.yaw, cart.pitch, cart.roll)
    angles = np.stack([cart.weave * yaw, cart.tilt * pitch, cart.tilt * roll], axis=1)
    turns = [rig_from_view(float(a), float(b), float(c)) @ mount for a, b, c in angles]
    return Drive(path.stamps_s, origins, np.stack([level @ turn for level, turn in zip(levels, turns, strict=True)]))


def _wander(share: Floats, rng: np.random.Generator) -> Floats:
    waves = rng.uniform([0.8, 2.0, 4.0], [1.6, 4.0, 9.0])
    phases = rng.uniform(0, 2 * np.pi, 3)
    weights = np.array([0.6, 0.3, 0.1])
    wave: Floats = (weights[:, None] * np.sin(2 * np.pi * waves[:, None] * share + phases[:, None])).sum(0)
    return wave if len(share) > 1 else np.zeros(1)


def world_from_level(heading: Floats) -> Floats:
    """Rotation (3, 3) of a level camera looking along the horizontal unit vector `heading` (3,)."""
    down = np.array([0.0, -1.0, 0.0])
    return np.stack([np.cross(down, heading), down, heading], axis=1)


@dataclass(frozen=True, eq=False)
class Course:
    """Frames' times `stamps_s` (n,), places on the floor (x, z) (n, 2) m, the way the cart faces (n, 2), unit, and how
    far along the drive it is (n,): 1 for the end of a line, or for every 15 m of a path."""

    stamps_s: Floats
    ground: Floats
    facing: Floats
    share: Floats


def course(cart: Cart, rng: np.random.Generator) -> Course:
    """The drive that a scene's cart section describes."""
    if cart.path is not None:
        return _along_path(cart.path, cart.fps, cart.speed_variation, rng)
    start, end = np.array(cart.start), np.array(cart.end)
    share = _progress(cart, rng)
    along = (end - start) / max(float(np.linalg.norm(end - start)), 1e-9)
    facing = np.tile(along, (cart.frames, 1))
    return Course(np.arange(cart.frames) / cart.fps, start + share[:, None] * (end - start), facing, share)


def _progress(cart: Cart, rng: np.random.Generator) -> Floats:
    speed = _unevenness(np.linspace(0, 1, cart.frames), cart.speed_variation, rng)
    steps = np.concatenate([[0.0], np.cumsum((speed[1:] + speed[:-1]) / 2)])
    share: Floats = steps / max(steps[-1], 1e-9)
    return share


def _unevenness(share: Floats, variation: float, rng: np.random.Generator) -> Floats:
    waves = rng.uniform(1, 3, 2)
    phases = rng.uniform(0, 2 * np.pi, 2)
    speed: Floats = 1 + variation * np.sin(2 * np.pi * waves[:, None] * share + phases[:, None]).mean(0)
    return speed


def _along_path(path: CartPath, fps: float, variation: float, rng: np.random.Generator) -> Course:
    ground, slow, halts = _rounded(path)
    steps = np.linalg.norm(np.diff(ground, axis=0), axis=1)
    metres = np.concatenate([[0.0], np.cumsum(steps)])
    waits = [(int(np.searchsorted(metres, place).clip(0, len(metres) - 1)), pause) for place, pause in path.stops]
    limit = np.where(slow, path.turn_speed, path.speed) * _unevenness(metres / _WAVES_M, variation, rng)
    limit[[0, -1, *halts, *(index for index, _ in waits)]] = _SLOWEST
    speed = _reachable(limit, steps, path.acceleration)
    passing = 2 * steps / (speed[1:] + speed[:-1])
    for index, pause in waits:
        passing[min(index, len(passing) - 1)] += pause
    times = np.concatenate([[0.0], np.cumsum(passing)])
    stamps = np.arange(0, times[-1], 1 / fps)
    places = np.stack([np.interp(stamps, times, ground[:, axis]) for axis in (0, 1)], axis=1)
    facing = _facing(ground, steps, halts)[np.searchsorted(times, stamps).clip(0, len(ground) - 1)]
    return Course(stamps, places, facing, np.interp(stamps, times, metres) / _WAVES_M)


def _rounded(path: CartPath) -> tuple[Floats, list[bool], list[int]]:
    """The path in small steps (n, 2), which of them are in corners (n,), and the indices at which it turns back."""
    points = np.array(path.points)
    pieces: list[tuple[Floats, bool]] = []
    halts: list[int] = []
    at = points[0]
    for before, corner, after in zip(points, points[1:], points[2:], strict=False):
        into, out = _unit(corner - before), _unit(after - corner)
        if into @ out < _TURN_BACK:
            pieces.append((_line(at, corner), False))
            halts.append(sum(len(piece) for piece, _ in pieces))
            at = corner
            continue
        room = min(np.linalg.norm(corner - before), np.linalg.norm(after - corner)) / 2
        arc = _arc(corner, into, out, path.radius, float(room))
        pieces += [(_line(at, arc[0]), False), (arc[:-1], True)]
        at = arc[-1]
    pieces.append((np.vstack([_line(at, points[-1]), points[-1]]), False))
    slow = [corner for piece, corner in pieces for _ in piece]
    return np.vstack([piece for piece, _ in pieces]), slow, halts


def _line(start: Floats, end: Floats) -> Floats:
    count = max(int(np.linalg.norm(end - start) / _STEP_M), 1)
    line: Floats = start + (np.arange(count) / count)[:, None] * (end - start)
    return line


def _arc(corner: Floats, into: Floats, out: Floats, radius: float, room: float) -> Floats:
    """An arc that leaves one leg and joins the other, of `radius` or as large as `room` on the legs allows."""
    bend = float(np.arctan2(into[0] * out[1] - into[1] * out[0], into @ out))
    if abs(bend) < 1e-6:
        return np.stack([corner, corner])
    radius = min(radius, room / np.tan(abs(bend) / 2))
    first = corner - into * radius * np.tan(abs(bend) / 2)
    left = np.array([-into[1], into[0]]) * np.sign(bend)
    angles = np.linspace(0, abs(bend), max(int(radius * abs(bend) / _STEP_M), 2) + 1)[:, None]
    arc: Floats = first + radius * (np.sin(angles) * into + (1 - np.cos(angles)) * left)
    return arc


def _unit(vector: Floats) -> Floats:
    unit: Floats = vector / np.linalg.norm(vector)
    return unit


def _reachable(limit: Floats, steps: Floats, acceleration: float) -> Floats:
    """Speeds (n,) under `limit` that a cart can reach and brake from."""
    speed = limit.copy()
    for index, step in enumerate(steps):
        speed[index + 1] = min(speed[index + 1], np.sqrt(speed[index] ** 2 + 2 * acceleration * step))
    for index in range(len(steps) - 1, -1, -1):
        speed[index] = min(speed[index], np.sqrt(speed[index + 1] ** 2 + 2 * acceleration * steps[index]))
    return speed


def _facing(ground: Floats, steps: Floats, halts: list[int]) -> Floats:
    """The way the cart faces (n, 2): along the path, or against it where it goes in reverse."""
    moves = np.diff(ground, axis=0) / np.maximum(steps, 1e-9)[:, None]
    moving = np.flatnonzero(steps > 1e-9)
    facing: Floats = moves[moving[np.searchsorted(moving, np.arange(len(ground))).clip(0, len(moving) - 1)]]
    for first, last in pairwise([*halts, len(ground)]):
        if halts.index(first) % 2 == 0:
            facing[first:last] *= -1
    return facing
