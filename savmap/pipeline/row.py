"""A row's map, from its passes of video: the whole method as one paragraph."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeVar

from savmap.errors import SavmapError, SolveError, StructureError
from savmap.graph import (
    Calibration,
    Constraints,
    Frames,
    Problem,
    References,
    Solution,
    SolveOptions,
    gauge,
    located,
    marker_constraints,
    merge,
    motion_constraints,
    solve,
    solve_rows,
)
from savmap.pipeline.initial_poses import initial_attitudes, initial_path
from savmap.pipeline.measure import RowMeasurements, observe, pass_names
from savmap.plugin.manager import LoadedPlugin
from savmap.site.model import Footage, Pass
from savmap.types import Flow, RowMap, Structure, Track, Trajectory
from savmap.types.progress import Monitor

Result = TypeVar("Result")


@dataclass(frozen=True)
class Row:
    """One row to be mapped: its passes, its references, the camera's path where an earlier map gives it, what of the camera is
    to be estimated, and whether points of any kind may help with its motion."""

    name: str
    passes: Sequence[Pass]
    references: References
    travel_m: float | None = None
    path: Trajectory | None = None
    calibration: Calibration | None = None
    appearance: bool = False


@dataclass(frozen=True)
class Followed:
    """Tracks and constraints by room, those of markers and of points of no structure, a note for each room or marker that was
    not found, and figures for the report."""

    tracks: Mapping[str, Sequence[Track]]
    constraints: Mapping[str, Constraints]
    others: tuple[Constraints, ...]
    notes: tuple[str, ...]
    report: Mapping[str, int]

    @property
    def every(self) -> tuple[Constraints, ...]:
        """All constraints."""
        return (*self.constraints.values(), *self.others)


@dataclass(frozen=True)
class Posed:
    """A row as a problem for the graph, and what it was made of."""

    row: Row
    plugins: Sequence[LoadedPlugin]
    seen: RowMeasurements
    followed: Followed
    problem: Problem

    @property
    def moments(self) -> list[tuple[Footage, float]]:
        """Which picture each frame is: the same in every row that is seen in it."""
        footage = {name: one.footage for name, one in zip(pass_names(self.row.passes), self.row.passes, strict=True)}
        table = self.seen.facts.frames
        return [(footage[name], stamp) for name, stamp in zip(table.passes, table.stamps_s.tolist(), strict=True)]


def look(row: Row, plugins: Sequence[LoadedPlugin], monitor: Monitor) -> RowMeasurements:
    """What is seen of a row: the only walk over its pixels. Raises SavmapError's kinds with what is wrong and what to do."""
    if plugins and all(plugin.needs_path for plugin in plugins):
        require_path(row.name, plugins[0], row.path)
    markers = row.references.markers if row.path is None else ()
    wanted = [(marker.dictionary, marker.number) for marker in markers]
    return observe(row.name, row.passes, plugins, monitor, initial_attitudes(row), wanted, row.appearance)


def map_rows(
    rows: Sequence[tuple[Row, Sequence[LoadedPlugin], RowMeasurements]], monitor: Monitor
) -> list[RowMap | SavmapError]:
    """Maps of rows from what was seen of them, solved together where they are seen in the same frames. A row that cannot be mapped
    comes back as its error, and the others are mapped without it."""
    tried = [attempt(pose, row, plugins, seen, monitor) for row, plugins, seen in rows]
    posed = [one for one in tried if isinstance(one, Posed)]
    everywhere = {plugin.name for one in posed for plugin in one.plugins}.difference(
        *(one.seen.locators for one in posed)
    )
    if len(posed) > 1:
        monitor.note(f"rows {' and '.join(one.row.name for one in posed)} share a pass: solving them together")
    solutions = iter(solve_rows([one.problem for one in posed], [one.moments for one in posed], everywhere))
    return [one if isinstance(one, SavmapError) else attempt(finished, one, next(solutions), monitor) for one in tried]


def attempt(step: Callable[..., Result], *arguments: object) -> Result | SavmapError:
    """What a step gives, or the expected error that it ends with."""
    try:
        return step(*arguments)
    except SavmapError as error:
        return error


def pose(row: Row, plugins: Sequence[LoadedPlugin], seen: RowMeasurements, monitor: Monitor) -> Posed:
    """From what was seen of a row to its factor graph."""
    references = row.references if row.path is None else References()
    start = initial_path(row, seen)
    frames = gauge(seen.facts, start, references, fixed=row.path, calibration=row.calibration)
    sound = [plugin for plugin in face_first(plugins, seen) if plugin.name not in seen.failed]
    followed = follow(row, sound, seen, start, frames)
    for note in followed.notes:
        monitor.note(note)
    problem = merge(frames, *followed.every)
    monitor.note(f"row {row.name}: {len(problem.used)} poses and {len(problem.keys)} points to solve for")
    return Posed(row, plugins, seen, followed, problem)


def finished(one: Posed, solution: Solution | SolveError, monitor: Monitor) -> RowMap:
    """The map of a solved row. Raises its error where it could not be solved."""
    if isinstance(solution, SolveError):
        raise solution
    for warning in solution.warnings:
        monitor.note(f"row {one.row.name}: {warning}")
    structures = described(one.plugins, one.seen, one.followed, solution)
    return row_map(one.row, one.seen, one.followed, solution, structures)


def follow(
    row: Row, plugins: Sequence[LoadedPlugin], seen: RowMeasurements, start: Trajectory, frames: Frames
) -> Followed:
    """Every room's tracks and constraints, and the markers'. What the first room sees locates the camera for those after
    it, and says which points of no structure may be believed; one of these rooms that finds no structure is left out of
    the map with a note."""
    tracks: dict[str, Sequence[Track]] = {}
    constraints: dict[str, Constraints] = {}
    markers, notes = marked(row, seen, start, frames)
    path, attitudes = row.path, start.world_from_rig[:, :3, :3]
    for plugin in plugins:
        if path is None and constraints:
            path = (vouched if seen.flows else located)(merge(frames, *constraints.values(), *markers))
        try:
            require_path(row.name, plugin, path)
            own = plugin.track(seen.features[plugin.name], seen.facts, attitudes, path)
        except StructureError as error:
            if not constraints:
                raise
            notes.append(f"row {row.name}: nothing of `{plugin.name}` is mapped: {error}")
            continue
        bound = plugin.constrain(own, seen.facts, path or start)
        if plugin.failure is None:
            tracks[plugin.name], constraints[plugin.name] = own, bound
    if row.path is not None or not seen.flows:
        return Followed(tracks, constraints, markers, tuple(notes), {})
    motion, counts = moved(merge(frames, *constraints.values(), *markers), seen.flows, path)
    return Followed(tracks, constraints, (*markers, motion), tuple(notes), counts)


def require_path(row: str, plugin: LoadedPlugin, path: Trajectory | None) -> None:
    """Raise StructureError where a plugin that cannot locate the camera would be asked to track without the camera's path."""
    if plugin.needs_path and path is None:
        raise StructureError(
            f"row {row}: `{plugin.name}` alone does not locate the camera: add a plugin that maps the face "
            f"(--plugins NAME,{plugin.name}), or give an earlier map with --trajectory"
        )


def moved(problem: Problem, flows: Sequence[Flow], path: Trajectory | None) -> tuple[Constraints, dict[str, int]]:
    """What points of no structure say of the camera's motion where they agree with the structures' path, and their counts."""
    return motion_constraints(flows, path or vouched(problem), problem.used)


def vouched(problem: Problem) -> Trajectory:
    """Where the camera was, and how well that is known: good enough to look for other things."""
    return solve(problem, SolveOptions(rounds=1)).trajectory


def marked(
    row: Row, seen: RowMeasurements, start: Trajectory, frames: Frames
) -> tuple[tuple[Constraints, ...], list[str]]:
    """Constraints of the markers that were seen, and a note for each of the others."""
    found, missed = marker_constraints(seen.marks.tracks, seen.marks.views, frames.references.markers, start)
    notes = [f"row {row.name}: marker {name} was not seen well enough; it is not used" for name in missed]
    return (found,) if found else (), notes


def described(
    plugins: Sequence[LoadedPlugin], seen: RowMeasurements, followed: Followed, solution: Solution
) -> dict[str, tuple[Structure, ...]]:
    """Structures of every room, which may say how they stand to the others'; none of a room that found nothing."""
    alone = {
        plugin.name: tuple(plugin.describe(followed.tracks[plugin.name], seen.facts, solution))
        if plugin.name in followed.tracks
        else ()
        for plugin in plugins
    }
    return {
        plugin.name: plugin.relate(
            alone[plugin.name], {name: own for name, own in alone.items() if name != plugin.name}
        )
        for plugin in plugins
    }


def face_first(plugins: Sequence[LoadedPlugin], seen: RowMeasurements) -> list[LoadedPlugin]:
    """Rooms that found the face come first: what they see locates the camera for the others."""
    return sorted(plugins, key=lambda plugin: plugin.name not in seen.locators)


def row_map(
    row: Row,
    seen: RowMeasurements,
    followed: Followed,
    solution: Solution,
    structures: Mapping[str, tuple[Structure, ...]],
) -> RowMap:
    """The record that is written to disk."""
    return RowMap(
        name=row.name,
        frames=seen.facts.frames,
        views=seen.facts.views,
        trajectory=solution.trajectory,
        structures=structures,
        references=tuple(solution.references),
        report={
            **solution.report,
            **followed.report,
            **{f"note {n}": note for n, note in enumerate((*seen.notes, *followed.notes, *solution.warnings), 1)},
        },
    )
