"""Footage with the wireframe over it, at the places of a row that deserve a look: a person can check the map there
without a survey."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from savmap.geometry.pinhole import intrinsics, project, rays_from_pixels
from savmap.geometry.sphere import panorama_pixels_from_rays
from savmap.report.templating import jpeg_address
from savmap.types import Floats, RowMap, Still, Structure

WIDTH_PX, HEIGHT_PX, JPEG_QUALITY = 480, 360, 80
LEAST_HFOV_DEG, MOST_HFOV_DEG, ROOM = 40.0, 95.0, 1.6
"""A structure and its surroundings are shown, 1.6 times as wide as it is."""
MOST_VIEWS, USUAL_VIEWS = 6, 2
"""Of a row: for its warnings, and for its weakest structures where it has fewer warnings."""
NEAR_M = 0.1
"""Nearer to the camera's plane, nothing is drawn."""
SHOWN, WARNED, UNDER = (86, 205, 255), (255, 120, 40), (0, 0, 0)
"""Lines in RGB, over a dark one: they are seen on bright and on dark footage."""

Picture = NDArray[np.uint8]
Key = tuple[str, str]
"""Plugin and id of a structure."""
Subject = tuple[str, Floats, frozenset[Key]]


@dataclass(frozen=True)
class FootageView:
    """A cut-out of a frame with the map over it: what it is about, where it was taken, and the picture as a data
    URI."""

    what: str
    place: str
    picture: str


def footage_views(row: RowMap, stills: Sequence[Still]) -> tuple[FootageView, ...]:
    """A view for each warning that has a place, then for the structures that the fewest frames support; none without
    stills."""
    poses = dict(zip(row.trajectory.frames.tolist(), row.trajectory.world_from_rig, strict=True))
    located = [still for still in stills if still.frame in poses]
    if not located:
        return ()
    centres = np.array([poses[still.frame][:3, 3] for still in located])
    views, decoded = [], dict[int, Picture]()
    for what, points, warned in _subjects(row):
        nearest = located[int(np.linalg.norm(centres - points.mean(axis=0), axis=1).argmin())]
        if nearest.frame not in decoded:
            decoded[nearest.frame] = np.asarray(
                cv2.cvtColor(np.asarray(cv2.imdecode(nearest.picture, cv2.IMREAD_COLOR)), cv2.COLOR_BGR2RGB), np.uint8
            )
        picture = _view(decoded[nearest.frame], poses[nearest.frame], points, row, warned)
        coded = cv2.imencode(".jpg", cv2.cvtColor(picture, cv2.COLOR_RGB2BGR), [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
        stamp, name = row.frames.stamps_s[nearest.frame], row.frames.passes[nearest.frame]
        place = f"{name}, {stamp:.1f} s, frame {nearest.frame}"
        views.append(FootageView(what, place, jpeg_address(coded[1].tobytes())))
    return tuple(views)


def _subjects(row: RowMap) -> Iterator[Subject]:
    """What is worth a look: why, its points (n, 3) m, and the structures that it is about."""
    structures = _structures(row)
    warnings = row.verdict.warnings if row.verdict else ()
    shown = list[Subject]()
    for warning in warnings:  # which names ids alone, so that all structures of such an id are meant
        keys = frozenset(key for key in structures if key[1] in warning.subjects)
        points = [structures[key].vertices for key in sorted(keys)] or [np.array([warning.place])]
        if keys or warning.place is not None:
            shown.append((warning.line, np.concatenate(points), keys))
    shown = shown[:MOST_VIEWS]
    yield from shown
    shown_keys = frozenset[Key]().union(*(keys for _, _, keys in shown))
    weakest = sorted((key for key in structures if key not in shown_keys), key=lambda key: _support(structures[key]))
    for key in weakest[: max(USUAL_VIEWS - len(shown), 0)]:
        what = f"{key[1]}: supported by {_support(structures[key]):.0%} of the frames"
        yield what, structures[key].vertices, frozenset({key})


def _structures(row: RowMap) -> dict[Key, Structure]:
    return {(plugin, structure.id): structure for plugin, group in row.structures.items() for structure in group}


def _support(structure: Structure) -> float:
    value = structure.attributes.get("support", 1.0)
    return float(value) if isinstance(value, int | float) else 1.0


def _view(panorama: Picture, world_from_rig: Floats, points: Floats, row: RowMap, warned: frozenset[Key]) -> Picture:
    world_from_view = looking_at(world_from_rig[:3, 3], points.mean(axis=0))
    centre = world_from_rig[:3, 3]
    rays = unit(points - centre)
    half = float(np.degrees(np.arccos(np.clip(rays @ unit(points.mean(axis=0) - centre), -1, 1))).max())
    camera = intrinsics(float(np.clip(2 * ROOM * half, LEAST_HFOV_DEG, MOST_HFOV_DEG)), WIDTH_PX, HEIGHT_PX)
    picture = _cut(panorama, world_from_rig[:3, :3].T @ world_from_view, camera)
    for key, structure in sorted(_structures(row).items(), key=lambda item: item[0] in warned):
        colour, width = (WARNED, 2) if key in warned else (SHOWN, 1)
        for ends in structure.vertices[structure.edges.reshape(-1, 2)]:
            _line(picture, (ends - world_from_rig[:3, 3]) @ world_from_view, camera, colour, width)
    return picture


def looking_at(centre: Floats, target: Floats) -> Floats:
    """world_from_view (3, 3) of a level view from one point (3,) towards another; straight up or down, its x axis is
    the row's."""
    ahead = unit(target - centre)
    right = np.cross(ahead, [0.0, 1.0, 0.0])
    right = unit(right) if np.linalg.norm(right) > 1e-6 else np.array([1.0, 0.0, 0.0])
    return np.column_stack([right, np.cross(ahead, right), ahead])


def unit(vectors: Floats) -> Floats:
    """Vectors (..., 3) of length 1."""
    scaled: Floats = vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)
    return scaled


def _cut(panorama: Picture, rig_from_view: Floats, camera: Floats) -> Picture:
    """The part (HEIGHT_PX, WIDTH_PX, 3) of a panorama that a view shows."""
    pixels = np.stack(np.meshgrid(np.arange(WIDTH_PX), np.arange(HEIGHT_PX)), axis=-1).astype(np.float64)
    rays = rays_from_pixels(pixels, camera) @ rig_from_view.T
    places = panorama_pixels_from_rays(rays, panorama.shape[0]).astype(np.float32)
    return cv2.remap(panorama, places[..., 0], places[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP).astype(
        np.uint8
    )


def _line(picture: Picture, ends: Floats, camera: Floats, colour: tuple[int, int, int], width: int) -> None:
    """Draw the part of a line, ends (2, 3) in the view's frame, that lies in front of the view."""
    depths = ends[:, 2]
    if depths.max() < NEAR_M:
        return
    if depths.min() < NEAR_M:
        behind, before = np.argsort(depths)
        share = (NEAR_M - depths[behind]) / (depths[before] - depths[behind])
        ends = np.array([ends[behind] + share * (ends[before] - ends[behind]), ends[before]])
    pixels = project(ends, camera)
    inside, first, second = cv2.clipLine(
        (0, 0, WIDTH_PX, HEIGHT_PX), *(np.clip(pixels, -1e6, 1e6).round().astype(int).tolist())
    )
    if inside:
        cv2.line(picture, first, second, UNDER, width + 2, cv2.LINE_AA)
        cv2.line(picture, first, second, colour, width, cv2.LINE_AA)
