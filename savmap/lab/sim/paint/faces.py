"""Planar faces as arrays, and how bright their corners are."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from savmap.types import Bools, Floats

Singles = NDArray[np.float32]
Numbers = NDArray[np.int32]

MOST_CORNERS = 12


@dataclass(frozen=True)
class Faces:
    """N planar convex faces. World frame, metres.

    A face is `origin` + a * `u` + b * `v`; its outline is given in (a, b), its texture lies upright where v points up.
    """

    origin: Floats  # (N, 3)
    u: Floats  # (N, 3)
    v: Floats  # (N, 3)
    outline: Floats  # (N, MOST_CORNERS, 2) in (a, b)
    corners: Numbers  # (N,) corners in use
    normals: Floats  # (N, 2, 3) unit, at a = 0 and a = 1: differing ones make a round surface
    two_sided: Bools  # (N,)
    tile: Numbers  # (N,)
    texture: Floats  # (N, 4): repetitions along u and v, offsets
    tint: Floats  # (N, 3) linear RGB
    label: Numbers  # (N,) class, 255 not to be judged
    thickness: Floats  # (N,) metres: a labelled face that looks thinner than the limit is not to be judged
    shade: Floats  # (N, 4) light at (0, 0), (1, 0), (0, 1), (1, 1), times what is given when it is made
    mesh: Floats  # (N, 3): wires along u, along v, and their share of the pitch; 0 is a closed face
    veil: Floats  # (N,) opacity of translucent faces, 0 for others

    def chosen(self, which: Bools) -> "Faces":
        """The faces where `which` is true."""
        return Faces(*(getattr(self, name)[which] for name in self.__dataclass_fields__))


def joined(parts: list[Faces]) -> Faces:
    """All faces of several sets, in order."""
    return Faces(*(np.concatenate([getattr(p, name) for p in parts]) for name in Faces.__dataclass_fields__))


def corner_points(faces: Faces) -> Floats:
    """World points (N, 4, 3) at (0, 0), (1, 0), (0, 1), (1, 1)."""
    o, u, v = faces.origin, faces.u, faces.v
    points: Floats = np.stack([o, o + u, o + v, o + u + v], axis=1)
    return points


@dataclass(frozen=True)
class Lighting:
    """Lamps as points, and light from everywhere."""

    lamps: Floats  # (L, 3) world
    power: Floats  # (L,) irradiance at one metre
    ambient: float
    from_above: float  # share of the ambient light that comes from above: undersides get less
    camera_power: float  # a light at the camera

    def at(self, points: Floats, normals: Floats, camera: Floats) -> Floats:
        """Irradiance (N, K) at points (N, K, 3) with unit normals of the same shape."""
        light: Floats = self.ambient * (1 - self.from_above * (0.5 - 0.5 * normals[..., 1]))
        places = np.concatenate([self.lamps, camera[None]])
        for place, power in zip(places, [*self.power, self.camera_power], strict=True):
            to = place - points
            squared = np.einsum("nki,nki->nk", to, to) + 0.5
            lambert = np.einsum("nki,nki->nk", to, normals) / np.sqrt(squared)
            light += power * np.clip(0.85 * lambert + 0.15, 0, None) / squared
        return light


def lit(faces: Faces, lighting: Lighting, camera: Floats) -> Singles:
    """Light (N, 4) at the faces' corners: what falls on them times their own shade."""
    normals = faces.normals[:, [0, 1, 0, 1]]
    towards = np.einsum("ni,ni->n", faces.normals[:, 0], camera - faces.origin) < 0
    normals = np.where((faces.two_sided & towards)[:, None, None], -normals, normals)
    return (lighting.at(corner_points(faces), normals, camera) * faces.shade).astype(np.float32)
