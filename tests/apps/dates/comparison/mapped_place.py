"""A place of posts, bars and plates as a map has it: with errors of its own and errors that all elements have in common."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from savmap.types import Attribute, FrameTable, JointCovariance, RowMap, SiteMap, Structure, Trajectory

OWN_M, SCALE_SIGMA, SETBACK_M = 0.0015, 0.004, 0.01
POST_M, BAR_M = 0.1, 0.1
RING = np.array([[0, 1], [1, 2], [2, 3], [3, 0]])


@dataclass(frozen=True)
class Bay:
    """Its width, the heights of its bars' middles, and what its plate says ("" for no plate)."""

    width: float
    heights: tuple[float, ...]
    text: str = ""


def irregular(count: int = 8) -> tuple[Bay, ...]:
    """Bays of one width and of heights that differ from bay to bay."""
    rng = np.random.default_rng(3)
    return tuple(
        Bay(2.7, tuple((0.3 + np.cumsum(rng.uniform(0.8, 1.4, 5))).tolist()), f"A{k + 1:02d}") for k in range(count)
    )


def moved_bar(bays: Sequence[Bay], bay: int, bar: int, by_m: float) -> tuple[Bay, ...]:
    heights = list(bays[bay].heights)
    heights[bar] += by_m
    return (*bays[:bay], replace(bays[bay], heights=tuple(heights)), *bays[bay + 1 :])


def mapped(bays: Sequence[Bay], seed: int = 0, reach: tuple[float, float] = (0.0, 1.0), name: str = "A") -> SiteMap:
    """The bays as a map has them. `reach`: from where to where the camera went, as shares of the row's length; what it did not pass
    is not mapped."""
    rng = np.random.default_rng(seed)
    scale, setback = rng.normal(0, SCALE_SIGMA, 2) * [0.1, 1.0], rng.normal(0, SETBACK_M)
    left = np.cumsum([0.0, *(bay.width + POST_M for bay in bays)])
    from_x, to_x = (share * left[-1] for share in reach)

    def box(kind: str, label: str, x: Sequence[float], y: Sequence[float], text: str = "") -> Structure:
        own = rng.normal(0, OWN_M, 4)
        xs = np.array(x) * (1 + scale[0]) + own[:2]
        ys = np.array(y) * (1 + scale[1]) + own[2:]
        corners = np.array([[xs[i], ys[j], setback] for i, j in ((0, 0), (1, 0), (1, 1), (0, 1))])
        sigmas = np.hypot(OWN_M, np.abs(corners) * [0.1 * SCALE_SIGMA, SCALE_SIGMA, 0] + [0, 0, SETBACK_M])
        covariances = np.array([np.diag(sigma**2) for sigma in sigmas])
        attributes: dict[str, Attribute] = {"text": text, "confidence": 0.99} if text else {}
        return Structure(label, kind, corners, covariances, ("a", "b", "c", "d"), RING, attributes)

    posts = [box("post", f"post {k + 1}", (x, x + POST_M), (0, 6)) for k, x in enumerate(left)]
    bars, plates = [], []
    for k, (x, bay) in enumerate(zip(left + POST_M, bays, strict=False)):
        for n, y in enumerate(bay.heights):
            bars.append(box("bar", f"bay {k + 1} / bar {n + 1}", (x, x + bay.width), (y - BAR_M / 2, y + BAR_M / 2)))
        if bay.text:
            plates.append(box("plate", f"plate {k + 1}", (x + 0.5, x + 0.9), (1.0, 1.2), bay.text))
    passed = [one for one in (*posts, *bars) if from_x - 0.2 <= one.vertices[:, 0].mean() <= to_x + 0.2]
    written = [one for one in plates if from_x <= one.vertices[:, 0].mean() <= to_x]
    return site_of(name, {"racks": tuple(passed), "plates": tuple(written)}, np.arange(from_x, to_x + 0.1, 0.2))


def site_of(name: str, structures: dict[str, tuple[Structure, ...]], places: np.ndarray) -> SiteMap:
    """A map of one row, whose camera was at these places along it."""
    poses = np.tile(np.eye(4), (len(places), 1, 1))
    poses[:, :3, 3] = np.stack([places, np.full(len(places), 1.6), np.full(len(places), 1.5)], axis=1)
    frames = FrameTable(np.arange(len(places)) / 10, ("pass 1",) * len(places))
    row = RowMap(name, frames, {}, Trajectory(np.arange(len(places)), poses), structures, ())
    return SiteMap({name: row}, {})


def half_turned(site: SiteMap) -> SiteMap:
    """The same map in a frame that is turned by half a turn about y."""
    return moved(site, np.diag([-1.0, 1.0, -1.0]))


def scaled(site: SiteMap, factor: float) -> SiteMap:
    """The same map as a wrong reference makes it: all lengths times a factor, the standard deviations as they were."""
    return moved(site, factor * np.eye(3))


def moved(site: SiteMap, linear: np.ndarray) -> SiteMap:
    """The same map with all places times a matrix (3, 3)."""
    rows = {}
    for name, row in site.rows.items():
        groups = {
            plugin: tuple(replace(one, vertices=one.vertices @ linear.T) for one in group)
            for plugin, group in row.structures.items()
        }
        poses = row.trajectory.world_from_rig.copy()
        poses[:, :3, 3] @= linear.T
        rows[name] = replace(row, structures=groups, trajectory=replace(row.trajectory, world_from_rig=poses))
    return replace(site, rows=rows)


def with_joint(site: SiteMap, scale_sigma: float) -> SiteMap:
    """The same map with a joint covariance: errors of each coordinate's own, and one scale that all have in common. The vertices' own covariances
    say nothing of that."""
    rows = {}
    for name, row in site.rows.items():
        named = [(plugin, one) for plugin, group in row.structures.items() for one in group]
        places = np.concatenate([one.vertices.ravel() for _, one in named])
        covariance = OWN_M**2 * np.eye(len(places)) + scale_sigma**2 * np.outer(places, places)
        coordinates: dict[str, dict[str, np.ndarray]] = {}
        first = 0
        for plugin, one in named:
            count = one.vertices.size
            coordinates.setdefault(plugin, {})[one.id] = np.arange(first, first + count).reshape(-1, 3)
            first += count
        own = {
            plugin: tuple(
                replace(one, covariances=np.tile(OWN_M**2 * np.eye(3), (len(one.vertices), 1, 1))) for one in group
            )
            for plugin, group in row.structures.items()
        }
        rows[name] = replace(row, structures=own, joint=JointCovariance(coordinates, covariance))
    return replace(site, rows=rows)
