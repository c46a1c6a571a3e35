"""The frames that maps are exported in: the rows' own, the site's (y up), and the world's, whose z axis points up."""

from dataclasses import dataclass, replace

import numpy as np

from savmap.errors import OutputError
from savmap.types import Alignment, Floats, Ints, Placement, SiteMap, Structure, array_record

Z_UP = np.array([[1.0, 0, 0], [0, 0, -1.0], [0, 1.0, 0]])
"""world_from_site (3, 3) of a site that is not aligned: x stays, y points up along z, and what comes towards one along
z goes down along y."""


@dataclass(frozen=True, eq=False)
class Element:
    """A structure in the world's frame, with its row and its plugin."""

    row: str
    plugin: str
    structure: Structure


@dataclass(frozen=True, eq=False)
@array_record
class Drive:
    """A row's trajectory in the world's frame: numbers (n) of the located frames, times (n) s, passes (n),
    world_from_rig (n, 4, 4). The rig's axes are the camera's: x right, y down, z ahead."""

    row: str
    frames: Ints
    stamps_s: Floats
    passes: tuple[str, ...]
    world_from_rig: Floats


def elements(site: SiteMap) -> list[Element]:
    """All structures in the world's frame: metres, right-handed, z up, floor at z = 0 unless the alignment says
    otherwise. Covariances hold the rows' placements and the site's alignment, too. Raises OutputError where rows have
    no common frame."""
    require_one_frame(site)
    return [
        Element(
            row.name, plugin, in_world(in_site(structure, site.placements.get(row.name)), alignment_of(site, row.name))
        )
        for row in site.rows.values()
        for plugin, structures in row.structures.items()
        for structure in structures
    ]


def drives(site: SiteMap) -> list[Drive]:
    """The trajectories of all rows in the world's frame. Raises OutputError as `elements` does."""
    require_one_frame(site)
    all_drives = []
    for row in site.rows.values():
        located = row.trajectory.frames.astype(np.int64)
        passes = tuple(row.frames.passes[frame] for frame in located)
        poses = world_from_row(site, row.name) @ row.trajectory.world_from_rig
        all_drives.append(Drive(row.name, located, row.frames.stamps_s[located], passes, poses))
    return all_drives


def world_from_row(site: SiteMap, row: str) -> Floats:
    """Transform (4, 4) from a row's frame to the world's."""
    placement = site.placements.get(row)
    site_from_row = np.eye(4) if placement is None else placement.site_from_row
    whole: Floats = world_from_site(alignment_of(site, row)) @ site_from_row
    return whole


def only_row(site: SiteMap, row: str) -> tuple[SiteMap, str]:
    """The map of one of its rows, and a note where the site's alignment does not hold for it and is left out: a
    row that is not placed among others, mapped or not, may stand anywhere in the user's world."""
    part = replace(site, rows={row: site.rows[row]})
    others = (site.rows.keys() | site.failed.keys()) - {row}
    if site.alignment is None or row in site.placements or not others:
        return part, ""
    note = f"row {row} has no place in the site's frame: it is written in its own frame, without the site's alignment"
    return replace(part, alignment=None), note


def alignment_of(site: SiteMap, row: str) -> Alignment | None:
    """The site's alignment, where it holds for the row: it is placed, or no row is, because it is the only one."""
    return site.alignment if row in site.placements or not site.placements else None


def world_from_site(alignment: Alignment | None) -> Floats:
    """Transform (4, 4) from the site's frame to the world's; `Z_UP` where the site is not aligned."""
    transform = np.eye(4)
    transform[:3, :3] = Z_UP
    return transform if alignment is None else alignment.world_from_level @ transform


def in_one_frame(site: SiteMap) -> tuple[SiteMap, str]:
    """The map of the rows that have a common frame, and a note of those that are left out. Raises OutputError where
    there are several rows, and none is placed."""
    rows = {name: row for name, row in site.rows.items() if name in site.placements}
    unplaced = ", ".join(name for name in site.rows if name not in rows)
    if not unplaced or len(site.rows) == 1:
        return site, ""
    what = f"rows {unplaced} have no place in the site's frame"
    advice = "give them a `place`, or the site a `layout`, and map again, or choose one with --row"
    if not rows:
        raise OutputError(f"{what}: {advice}")
    return replace(site, rows=rows), f"{what} and are left out: {advice}"


def require_one_frame(site: SiteMap) -> None:
    """Raise OutputError where there are several rows and one of them is not placed, because its frame is another
    one."""
    if note := in_one_frame(site)[1]:
        raise OutputError(note)


def in_site(structure: Structure, placement: Placement | None) -> Structure:
    """A row's structure in the site's frame, the placement's covariance added; unchanged where the row is not
    placed."""
    if placement is None:
        return structure
    covariances = placement.covariances(structure.vertices, structure.covariances)
    return _moved(structure, placement.site_from_row, covariances)


def in_world(structure: Structure, alignment: Alignment | None) -> Structure:
    """A structure of the site's frame in the world's, the alignment's covariance added."""
    transform = world_from_site(alignment)
    turn = transform[:3, :3]
    moved = _moved(structure, transform, turn @ structure.covariances @ turn.T)
    if alignment is None:
        return moved
    return replace(moved, covariances=moved.covariances + alignment.covariances(moved.vertices))


def _moved(structure: Structure, transform: Floats, covariances: Floats) -> Structure:
    solid, vertices = structure.solid, transformed(structure.vertices, transform)
    if solid is not None:
        depth = transform[:3, :3] @ solid.depth
        solid = replace(solid, outline=transformed(solid.outline, transform), depth=depth)
    return replace(structure, vertices=vertices, covariances=covariances, solid=solid)


def transformed(points: Floats, transform: Floats) -> Floats:
    """Points (n, 3) by a transform (4, 4)."""
    result: Floats = points @ transform[:3, :3].T + transform[:3, 3]
    return result
