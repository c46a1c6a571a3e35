"""Rows, from video to map: the whole method as one sentence, and its verbs."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np

from savmap import graph
from savmap.errors import SavmapError, SiteError, SolveError, StructureError
from savmap.files.journal import Journal
from savmap.graph import Constraints
from savmap.graph.joint_covariance import joint_covariance
from savmap.pipeline.drive import require_path, walk
from savmap.pipeline.finding import find_structures, uncertain_objects
from savmap.pipeline.path import completed, first_poses
from savmap.pipeline.recognising import NO_MARKS, assumed_length, bare, frame_references
from savmap.pipeline.records import (
    DescribedRow,
    LocatedRow,
    MeasuredRow,
    PosedRow,
    RowMeasurements,
    RowRequest,
    SolvedRow,
    TrackedRow,
    each,
)
from savmap.pipeline.trust.verdict import judge
from savmap.plugin.apps import dates
from savmap.plugin.manager import LoadedPlugin
from savmap.types import FoundObject, JointCovariance, MapWarning, PlanePatch, RowMap, Structure, Track, Trajectory
from savmap.types.maps import SKIPPED, UNCHECKED
from savmap.types.progress import Monitor, SilentMonitor

ROOM_M = 0.3
"""Shown of a face around its structures."""
NOT_FOUND = "what it is of was not found"
"""Of a reference."""
FIRST_SOLVE = graph.SolveOptions(rounds=2, judge=False)
"""Of a row that is to be recognised: its references are none that could be wrong."""


def measure(requests: Sequence[RowRequest], journal: Journal, monitor: Monitor) -> list[MeasuredRow | SavmapError]:
    """What the rows' pictures show: one walk over the pixels for all of them, then what the evidence of all frames
    together shows, measured in what was kept of each. A row that cannot be measured comes back as its error."""
    walked = walk(requests, journal, monitor)
    return each(walked, lambda row: find_structures(row, monitor))


def map_rows(measured: Sequence[MeasuredRow | SavmapError], monitor: Monitor) -> list[RowMap | SavmapError]:
    """Maps of measured rows, solved together where they are seen in the same frames (paper, section III). A row that
    cannot be mapped comes back as its error, and the others are mapped without it."""
    located = each(measured, locate)
    recognised = each(located, lambda row: recognise(row, monitor))
    tracked = each(recognised, lambda row: track(row, monitor))
    posed = each(tracked, lambda row: constrain(row, monitor))
    solved = solve(posed, recognised, monitor)
    described = each(solved, describe)
    return each(described, collect)


def locate(row: MeasuredRow) -> LocatedRow:
    """The first poses of the frames, in the row's frame. Raises StructureError."""
    request = completed(row.request, row.measurements.facts.frames)
    start, frames = first_poses(request, row.measurements)
    return LocatedRow(**{**vars(row), "request": request}, start=start, frames=frames)


def recognise(row: LocatedRow, monitor: Monitor) -> LocatedRow:
    """The row with its place in an earlier map and the references that follow from it, by a first solve in an assumed
    scale; itself where there is no earlier map. Raises StructureError where it could be at several places, or at
    none."""
    if not row.request.against:
        return row
    measurements = replace(row.measurements, flows=(), depths=(), marks=NO_MARKS)
    tracked = track(replace(row, measurements=measurements, frames=bare(row.frames)), SilentMonitor())
    parts = (*tracked.constraints.values(), *tracked.camera_constraints)
    located = graph.locate_camera(graph.merge(tracked.frames, *parts, partial=True))
    of_locators = [located.points[name] for name in tracked.tracks if name in row.measurements.locators]
    frames = replace(tracked.frames, references=assumed_length(of_locators))
    problem = graph.merge(frames, *parts, partial=True)
    solved = SolvedRow(**vars(tracked), problem=problem, solution=graph.solve(problem, FIRST_SOLVE))
    facts, structures = row.measurements.facts, describe(solved).structures
    seen = RowMap(row.request.name, facts.frames, facts.views, solved.solution.trajectory, structures, ())
    place = dates().recognised(seen, row.request.against)
    monitor.note(f"row {row.request.name}: recognised as row {place.ends}")
    references = frame_references(place, row.request.against[place.row], structures, solved.solution)
    request = replace(row.request, references=references)
    return replace(row, request=request, frames=replace(row.frames, references=references), place=place)


def track(row: LocatedRow, monitor: Monitor) -> TrackedRow:
    """Every plugin's tracks and constraints, the markers' and the floor's.

    What the first plugin tracks locates the camera for those after it, with an assumed scale where only these give it.
    One of these that finds no structure is left out of the map with a note. Raises StructureError where the first one
    finds none.
    """
    tracks: dict[str, Sequence[Track]] = {}
    constraints: dict[str, Constraints] = {}
    others, notes = marker_constraints(row)
    floor = floor_constraints(row)
    others = (*others, *floor)
    path, assumed = row.request.path, False
    for plugin in plugins_in_order(row.request.plugins, row.measurements):
        if constraints and (path is None or assumed):
            path, assumed = locate_camera(row, [*constraints.values(), *others])
        try:
            plugin_tracks = track_plugin(plugin, row, path)
        except StructureError as error:
            if not constraints:
                raise
            notes.append(f"row {row.request.name}: nothing of `{plugin.name}` is mapped: {error}")
            continue
        plugin_constraints = constrain_plugin(plugin, plugin_tracks, row, path)
        if plugin.failure is None:
            tracks[plugin.name] = plugin_tracks
            constraints[plugin.name] = graph.without_presumed(plugin_constraints) if floor else plugin_constraints
    row = with_found_references(row, [*constraints.values(), *others])
    metric_path = None if assumed else path
    constraints, depths = with_flat_depths(row, constraints, others, metric_path)
    notes += [note_of(depth, row.request.name) for depth in depths if not depth.likely]
    motion, figures = motion_constraints(row, [*constraints.values(), *others], metric_path)
    for note in notes:
        monitor.note(note)
    return TrackedRow(
        **vars(row),
        tracks=tracks,
        constraints=constraints,
        camera_constraints=(*others, *motion),
        notes=tuple(notes),
        figures={
            **figures,
            **{f"places that tell how deep {depth.landmark} lies": depth.sections for depth in depths if depth.likely},
        },
    )


def with_found_references(row: LocatedRow, parts: Sequence[Constraints]) -> LocatedRow:
    """The row without references to what was not found in it, each with a warning: that is no reason to map nothing."""
    references, missed = graph.found_references(row.frames.references, parts, row.request.name)
    warnings = [MapWarning("reference-conflict", (name,), NOT_FOUND, details=(line,)) for name, line in missed.items()]
    measurements = replace(row.measurements, warnings=(*row.measurements.warnings, *warnings))
    return replace(row, frames=replace(row.frames, references=references), measurements=measurements)


def constrain(row: TrackedRow, monitor: Monitor) -> PosedRow:
    """All constraints and references as one problem for the graph. Raises SiteError for a reference to what was not
    found."""
    parts = (*row.constraints.values(), *row.camera_constraints)
    problem = graph.merge(row.frames, *parts)
    monitor.note(f"row {row.request.name}: {len(problem.used)} poses and {len(problem.keys)} points to solve for")
    return PosedRow(**vars(row), problem=problem)


def solve(
    rows: Sequence[PosedRow | SavmapError], located: Sequence[LocatedRow | SavmapError], monitor: Monitor
) -> list[SolvedRow | SavmapError]:
    """The rows' solutions, solved as one where they share frames; refused where their sides are swapped."""
    posed = [row for row in rows if isinstance(row, PosedRow)]
    plugins = {plugin.name for row in posed for plugin in row.request.plugins}
    everywhere = plugins.difference(*(row.measurements.locators for row in posed))
    if len(posed) > 1:
        monitor.note(f"rows {' and '.join(row.request.name for row in posed)} share a pass: solving them together")
    solutions = iter(graph.solve_rows([row.problem for row in posed], [row.moments for row in posed], everywhere))
    as_given = each(rows, lambda row: _solved(row, next(solutions)))
    swapped = swapped_sides(located, as_given)
    solved = [swapped.get(number, row) for number, row in enumerate(as_given)]
    return each(solved, lambda row: _with_notes(row, monitor))


def swapped_sides(
    located: Sequence[LocatedRow | SavmapError], solved: Sequence[SolvedRow | SavmapError]
) -> dict[int, SavmapError]:
    """An error for two rows of a drive, by their numbers, of which one does not fit its references, not even alone,
    where those of either fit the other."""
    errors = dict[int, SavmapError]()
    for (a, row), (b, other) in combinations(enumerate(located), 2):
        if isinstance(row, SavmapError) or isinstance(other, SavmapError) or not {*row.moments} & {*other.moments}:
            continue
        refuted = _is_refuted(solved[a]) or _is_refuted(solved[b])
        if refuted and not (_fits(row, row) and _fits(other, other)) and _fits(row, other) and _fits(other, row):
            rows = f"rows {row.request.name} and {other.request.name}"
            errors[a] = errors[b] = SiteError(f"{rows}: the references of each fit the other: swap their `side`")
    return errors


def _is_refuted(row: SolvedRow | SavmapError) -> bool:
    """Whether a row contradicts its references."""
    return isinstance(row, SavmapError) or any(item.code == "reference-conflict" for item in row.solution.warnings)


def _fits(row: LocatedRow, other: LocatedRow) -> bool:
    """Whether a row can be mapped with the references of another one, and does not contradict them."""
    plugins = [plugin for plugin in other.request.plugins if plugin.name in row.measurements.locators]
    request = replace(row.request, references=other.request.references, plugins=plugins)
    frames = replace(row.frames, references=other.frames.references)
    try:
        tracked = track(replace(row, request=request, frames=frames), SilentMonitor())
        solution = graph.solve(constrain(tracked, SilentMonitor()).problem)
    except SavmapError:
        return False
    return not any(item.code == "reference-conflict" for item in solution.warnings)


def describe(row: SolvedRow) -> DescribedRow:
    """Structures of every plugin, which may say how they stand to the others'; none of a plugin that found nothing."""
    described = {
        plugin.name: tuple(plugin.describe(row.tracks[plugin.name], row.measurements.facts, row.solution))
        if plugin.name in row.tracks
        else ()
        for plugin in row.request.plugins
    }
    related: dict[str, tuple[Structure, ...]] = {
        plugin.name: tuple(
            plugin.relate(
                described[plugin.name], {name: group for name, group in described.items() if name != plugin.name}
            )
        )
        for plugin in row.request.plugins
    }
    objects = {item.id: item for group in row.measurements.objects.values() for item in group}
    sure = {name: tuple(_with_probability(part, objects) for part in group) for name, group in related.items()}
    uncertain = uncertain_objects(objects.values(), [part for group in sure.values() for part in group])
    return DescribedRow(**vars(row), structures=sure, face=face_of(row, sure), uncertain=uncertain)


def _with_probability(structure: Structure, objects: Mapping[str, FoundObject]) -> Structure:
    """A structure with the probability that it exists, where its plugin's model gave one."""
    if structure.id not in objects:
        return structure
    return replace(structure, attributes={**structure.attributes, "probability": objects[structure.id].probability})


def face_of(row: SolvedRow, structures: Mapping[str, Sequence[Structure]]) -> PlanePatch | None:
    """The first plane that a plugin's structures lie in, with some room around them; None where no plugin knows one."""
    for plugin in row.request.plugins:
        if not plugin.has("planes") or not structures[plugin.name]:
            continue
        landmarks = row.solution.landmarks_of(plugin.name)
        patches = plugin.planes({name: landmark.position for name, landmark in landmarks.items()})
        if patches:
            return patches[0].around(np.concatenate([part.vertices for part in structures[plugin.name]]), ROOM_M)
    return None


def collect(row: DescribedRow) -> RowMap:
    """The row's map, judged, in the frame of the row that it was recognised as: the record that is written to disk."""
    facts, solution = row.measurements.facts, row.solution
    notes = (*row.measurements.notes, *row.notes, *solution.notes)
    structures, verdict = judge(row)
    joint = joint_covariance(structures, solution)
    largest_m = float(np.abs(solution.covariance.hidden).max(initial=0.0))
    row_map = RowMap(
        name=row.request.name,
        frames=facts.frames,
        views=facts.views,
        trajectory=solution.trajectory,
        structures={
            plugin: tuple(with_unchecked(plugin, part, joint, largest_m) for part in group)
            for plugin, group in structures.items()
        },
        references=tuple(solution.references),
        report={
            **solution.report,
            **row.figures,
            SKIPPED: row.measurements.skipped,
            **{f"note {number}": note for number, note in enumerate(notes, 1)},
        },
        face=row.face,
        verdict=verdict,
        joint=joint,
    )
    if row.place is None:
        return row_map
    return dates().in_row(row_map, row.place, row.request.against[row.place.row])


def with_unchecked(plugin: str, part: Structure, joint: JointCovariance | None, largest_m: float) -> Structure:
    """A structure with how far it may be off before a second reference shows it, where that is a millimetre or more: as
    far as the `largest_m` of the row where none of its coordinates was solved for."""
    moves = [joint.moves(plugin, part, number) for number in range(len(part.vertices))] if joint else []
    off_m = round(float(np.abs(moves).max(initial=0.0) or largest_m), 3)
    return replace(part, attributes={**part.attributes, UNCHECKED: off_m}) if off_m else part


def plugins_in_order(plugins: Sequence[LoadedPlugin], measurements: RowMeasurements) -> Iterator[LoadedPlugin]:
    """The plugins to be tracked: those that found the face come first, for what they see locates the camera for the
    others."""
    healthy = (plugin for plugin in plugins if plugin.name not in measurements.failed)
    yield from sorted(healthy, key=lambda plugin: plugin.name not in measurements.locators)


def track_plugin(plugin: LoadedPlugin, row: LocatedRow, path: Trajectory | None) -> list[Track]:
    """One plugin's tracks. `path`: where the camera was, where that is known; up to scale for what locates it. Raises
    StructureError where it finds no structure."""
    require_path(row.request.name, plugin, path)
    features, attitudes = row.measurements.features[plugin.name], row.start.world_from_rig[:, :3, :3]
    start = path or row.measurements.path if plugin.name in row.measurements.locators else path
    return plugin.track(features, row.measurements.facts, attitudes, start)


def constrain_plugin(
    plugin: LoadedPlugin, tracks: Sequence[Track], row: LocatedRow, path: Trajectory | None
) -> Constraints:
    """One plugin's constraints. Raises SiteError or StructureError where the tracks do not fit what is given of the
    row. The message says where frames are missing, for a gap splits structures or joins them."""
    facts = row.measurements.facts
    try:
        return plugin.constrain(tracks, facts, path or row.start)
    except (SiteError, StructureError) as error:
        gap = graph.where_tracks_miss_frames(tracks, facts.frames)
        raise type(error)(f"{error}; {gap}") if gap else error from None


def locate_camera(row: LocatedRow, constraints: Sequence[Constraints]) -> tuple[Trajectory, bool]:
    """Where the camera was, by the constraints known so far: well enough to look for other structures; and whether its
    scale is assumed, for want of a reference to what was tracked so far."""
    problem = graph.merge(row.frames, *constraints, partial=True)
    located = graph.locate_camera(problem, sigmas=bool(row.measurements.flows))
    return located.path, bool(located.assumed)


def with_flat_depths(
    row: LocatedRow, constraints: Mapping[str, Constraints], others: Sequence[Constraints], path: Trajectory | None
) -> tuple[dict[str, Constraints], list[graph.MeasuredDepth]]:
    """The plugins' constraints with how deep flat parts of their structures lie, and what the pictures told of that."""
    flat_parts = row.measurements.depths
    if not flat_parts:
        return dict(constraints), []
    if path is None:
        try:
            parts = (*constraints.values(), *others)
            path = graph.locate_camera(graph.merge(row.frames, *parts)).path
        except SolveError:  # the solve will tell
            return dict(constraints), []
    depths = list(graph.measured_depths(flat_parts, constraints, path))
    return graph.with_depths(constraints, depths), depths


def note_of(depth: graph.MeasuredDepth, row: str) -> str:
    """What to tell the user where what shows on flat parts does not fit what is known of them."""
    at, sigma = depth.relation.value, depth.relation.sigma
    place = f"{depth.relation.axis} = {100 * at:.1f} +- {100 * sigma:.1f} cm"
    return (
        f"row {row}: what shows at {depth.landmark} and the like would lie at {place}: "
        "other things hang there, so it does not tell how deep they lie"
    )


def motion_constraints(
    row: LocatedRow, constraints: Sequence[Constraints], path: Trajectory | None
) -> tuple[tuple[Constraints, ...], Mapping[str, int]]:
    """What points of no structure say of the camera's motion where they agree with the structures' path, and their
    counts; nothing where an earlier map gives the path."""
    if row.request.path is not None or not row.measurements.flows:
        return (), {}
    problem = graph.merge(row.frames, *constraints)
    path = path or graph.locate_camera(problem, sigmas=True).path
    motion, counts = graph.motion_constraints(row.measurements.flows, path, problem.used)
    return (motion,), counts


def marker_constraints(row: LocatedRow) -> tuple[tuple[Constraints, ...], list[str]]:
    """Constraints of the markers that were seen, and a note for each of the others."""
    marks, markers = row.measurements.marks, row.frames.references.markers
    constraints, missed = graph.marker_constraints(marks.tracks, marks.views, markers, row.start)
    notes = [f"row {row.request.name}: marker {name} was not seen well enough; it is not used" for name in missed]
    return (constraints,) if constraints else (), notes


def floor_constraints(row: LocatedRow) -> tuple[Constraints, ...]:
    """Constraints of the floor where the pictures show it; none where an earlier map gives the path."""
    floor = row.measurements.floor
    if row.request.path is not None:
        return ()
    part = graph.floor_constraints(floor.tracks, floor.views, floor.sigma, row.frames.references, row.start)
    return (part,) if part is not None else ()


def _solved(row: PosedRow, solution: graph.Solution | SolveError) -> SolvedRow:
    if isinstance(solution, SolveError):
        missed = [item.details[0] for item in row.measurements.warnings if item.figure == NOT_FOUND]
        raise SiteError(missed[0]) if missed else solution
    return SolvedRow(**vars(row), solution=solution)


def _with_notes(row: SolvedRow, monitor: Monitor) -> SolvedRow:
    """The row, once its notes are said."""
    for note in row.solution.notes:
        monitor.note(f"row {row.request.name}: {note}")
    return row
