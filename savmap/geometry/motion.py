"""The motion of a camera from rays: of two pictures (eight points: Longuet-Higgins 1981; RANSAC: Fischler and Bolles
1981), and of one picture and known points (resection)."""

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from savmap.geometry.arrays import Bools, Floats

SAMPLES, OF_EACH = 150, 8
AGREES = 4.0
"""Sigmas by which a ray that agrees with a motion may be off."""
REFINED = 3
"""How often a motion of two pictures is refined: eight points' leaves out some that agree."""
ROUNDS, FIRST_SCALE, LAST_SCALE = 10, 16.0, 1.5
"""Of a resection; residuals of so many sigmas count half, at first and in the end."""
QUARTER = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])


def two_views(first: Floats, second: Floats, sigma: float, seed: int = 0) -> tuple[Floats, Bools]:
    """first_from_second (4, 4) by unit rays (n, 3) of the same n >= 8 points, in each camera's frame, with a position
    of length 1; and the points (n,) that agree with it, to standard deviations of `sigma` radians."""
    products = (second[:, :, None] * first[:, None, :]).reshape(len(first), 9)
    essential, agrees = _best_sample(products, first, second, sigma, seed)
    left, _, right = np.linalg.svd(essential)
    turns = [turn * np.sign(np.linalg.det(turn)) for turn in (left @ QUARTER @ right, left @ QUARTER.T @ right)]
    options = [(turn, way * left[:, 2]) for turn in turns for way in (1.0, -1.0)]
    turn, towards = max(options, key=lambda option: int((_in_front(first, second, *option) & agrees).sum()))
    for _ in range(REFINED):
        turn, towards = _refined(first[agrees], second[agrees], sigma, turn, towards)
        off = np.abs(_off_plane(first, second, turn, towards))
        agrees = (off < AGREES * sigma) & _in_front(first, second, turn, towards)
        if agrees.sum() < OF_EACH:
            break
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = turn.T, -turn.T @ towards
    return pose, agrees


def _best_sample(products: Floats, first: Floats, second: Floats, sigma: float, seed: int) -> tuple[Floats, Bools]:
    """The essential matrix (3, 3) of the eight points with which most agree, and which do (n,)."""
    rng = np.random.default_rng(seed)
    picks = np.argsort(rng.random((SAMPLES, len(products))), axis=1)[:, :OF_EACH]
    left, _, right = np.linalg.svd(np.linalg.svd(products[picks])[2][:, -1].reshape(-1, 3, 3))
    essential = left @ np.diag([1.0, 1.0, 0.0]) @ right
    normals = np.einsum("sij,nj->sni", essential, first)
    off = np.abs(np.einsum("ni,sni->sn", second, normals)) / np.maximum(np.linalg.norm(normals, axis=2), 1e-9)
    agrees = off < AGREES * sigma
    best = int(agrees.sum(axis=1).argmax())
    return essential[best], agrees[best]


def _in_front(first: Floats, second: Floats, turn: Floats, towards: Floats) -> Bools:
    """Whether points (n,) lie in front of both cameras, where second = turn first + towards."""
    turned = first @ turn.T
    cosine = (turned * second).sum(axis=1)
    along = (cosine * (second @ towards) - turned @ towards) / np.maximum(1 - cosine**2, 1e-9)
    return np.asarray((along > 0) & (along * cosine + second @ towards > 0))


def _off_plane(first: Floats, second: Floats, turn: Floats, towards: Floats) -> Floats:
    """The angles (n,) between rays and the planes of both cameras and the other ray, radians."""
    normals = np.cross(np.broadcast_to(towards, first.shape), first @ turn.T)
    off: Floats = (second * normals).sum(axis=1) / np.maximum(np.linalg.norm(normals, axis=1), 1e-3)
    return off


def _refined(first: Floats, second: Floats, sigma: float, turn: Floats, towards: Floats) -> tuple[Floats, Floats]:
    """Turn and direction with the least angles between rays and planes."""
    side = np.linalg.svd(towards[None])[2][1:]

    def moved(change: Floats) -> tuple[Floats, Floats]:
        direction = towards + change[3:] @ side
        return Rotation.from_rotvec(change[:3]).as_matrix() @ turn, direction / np.linalg.norm(direction)

    def off(change: Floats) -> Floats:
        return _off_plane(first, second, *moved(change)) / sigma

    fitted = least_squares(off, np.zeros(5), loss="soft_l1", f_scale=2.0)
    return moved(fitted.x)


def resected(points: Floats, rays: Floats, start: Floats, sigma: float) -> tuple[Floats, Floats, Floats]:
    """world_from_camera (4, 4) by unit rays (n, 3) to known points (n, 3), from `start` (4, 4); its covariance (6, 6)
    for standard deviations of `sigma` radians, turn in the camera's frame before position; and by how many radians
    the rays are off (n,). Outliers count less and less (Cauchy)."""
    pose = start.copy()
    scales = np.geomspace(FIRST_SCALE, LAST_SCALE, ROUNDS) * sigma
    for scale in scales:
        error, rows = _rows(points, rays, pose)
        weights = 1 / (1 + np.square(error).sum(axis=1) / scale**2)
        normal = np.einsum("n,nij,nik->jk", weights, rows, rows) + 1e-12 * np.eye(6)
        change = np.linalg.solve(normal, -np.einsum("n,nij,ni->j", weights, rows, error))
        pose[:3, :3] = pose[:3, :3] @ Rotation.from_rotvec(change[:3]).as_matrix()
        pose[:3, 3] += change[3:]
    error, _ = _rows(points, rays, pose)
    return pose, sigma**2 * np.linalg.inv(normal), np.linalg.norm(error, axis=1)


def _rows(points: Floats, rays: Floats, pose: Floats) -> tuple[Floats, Floats]:
    """By how much directions to points are off rays (n, 3), and how that changes (n, 3, 6) with turn and position."""
    towards = (points - pose[:3, 3]) @ pose[:3, :3]
    distance = np.maximum(np.linalg.norm(towards, axis=1), 1e-9)
    unit = towards / distance[:, None]
    zero = np.zeros(len(unit))
    x, y, z = unit.T
    by_turn = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=1).reshape(-1, 3, 3)
    across = np.eye(3) - unit[:, :, None] * unit[:, None, :]
    by_place = -(across @ pose[:3, :3].T) / distance[:, None, None]
    return unit - rays, np.concatenate([by_turn, by_place], axis=2)
