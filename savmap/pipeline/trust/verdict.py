"""The verdict on a row's map: all that speaks against it, from every stage of its making."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from savmap.graph import Landmark, Solution
from savmap.pipeline.records import DescribedRow
from savmap.pipeline.trust.support import Support, is_of, supports
from savmap.plugin.manager import LoadedPlugin
from savmap.types import Floats, FoundObject, MapWarning, Structure, Verdict
from savmap.video.course import ASTRAY_DEG, TURNED_DEG
from savmap.video.motion import wrapped
from savmap.vision.views import LEGIBLE

SURE = 0.01
"""An element exists, or does not, where its probability is so near to 1 or 0."""
LEAST_SUPPORT, LEAST_OF_USUAL, LEAST_EXPECTED = 0.2, 0.35, 5
VAGUE_M, VAGUE, UNKNOWN_M = 0.03, 3.0, 1.0
"""A place is not known well where a coordinate's standard deviation is larger than `VAGUE_M`, and than `VAGUE` times
that of most of its label: along a row that one camera height measures, all are known less well, and the references say
so. From `UNKNOWN_M` on it is not known at all."""
MOST_REJECTED, FAR_M = 0.5, 0.01
"""A structure is inconsistent where a larger share of its measurements was rejected and is further from it than
`FAR_M`. Nearer ones do not count: a structure is not wrong by more than they are."""
SCATTERED_M, SCATTERED = 0.02, 4.0
"""A structure is inconsistent where the median distance of its measurements is larger than `SCATTERED_M`, and than
`SCATTERED` times that of all structures of its label: they are then of several things."""
OFTEN_SEEN, UNMAPPED, GLARE = 0.5, 0.2, 0.05
"""A part may be missing where nothing is mapped in such a share of the frames though they show something, or glare in
more than the third: half of the frames where nothing is mapped at all, else a fifth (of ceilings of train rows at once,
twice and four times their exposure, whole maps leave out 0.1 at most, most others 0.25 at least)."""
OFF_DEG, OFF_SHARE = 0.02, 0.08
"""What a plugin measured is off in the camera's directions where it is so by a larger angle, which explains a larger
share of its squared errors."""
STRETCHED_SIGMA, STRETCHED = 4.0, 0.002
"""A vertical scale is warned of that differs from 1 by more than so many standard deviations, and by more than such a
share."""
AXES = "xyz"


def judge(row: DescribedRow) -> tuple[Mapping[str, tuple[Structure, ...]], Verdict]:
    """The row's structures by plugin, each with its `support`, and the verdict. What lies wholly beyond the row's ends
    is mapped where it was seen, from afar and aslant, but is none of the row's, and speaks against nothing."""
    mapped: dict[str, tuple[Structure, ...]] = {}
    bent = [*_stretched(row.solution), *_bent(row.solution)]
    footage = (warning for warning in row.measurements.warnings if not _is_refuted(warning, row))
    warnings = [*footage, *row.solution.warnings, *(bent or _no_panorama(row))]
    of_elements = list(_uncertain_objects(row.uncertain))
    for plugin in row.request.plugins:
        structures = row.structures.get(plugin.name, ())
        support = supports(structures, row.tracks.get(plugin.name, ()), row.solution.trajectory, row.measurements.facts)
        mapped[plugin.name] = tuple(_with_support(structure, support[structure.id]) for structure in structures)
        warnings += _unmapped(row, plugin)
        of_elements += [*plugin.warnings(structures), *_uncertain(structures, support), *_inaccurate(structures)]
        of_elements += _contradicted(structures, row.solution, plugin.name)
    warnings += [warning for warning in of_elements if not _is_beyond(warning, row)]
    notes = (*row.solution.unchecked, *row.notes)
    return mapped, Verdict(tuple(dict.fromkeys(warnings)), tuple(dict.fromkeys(notes)))


def _with_support(structure: Structure, support: Support) -> Structure:
    return replace(structure, attributes={**structure.attributes, "support": round(support.share, 3)})


def _is_refuted(warning: MapWarning, row: DescribedRow) -> bool:
    """Whether the footage alone seemed to show that the camera turns or leaves the row, and its solved path says that
    it did neither then: apparent motion adds its errors up, and what was measured of structures does not."""
    path, passes, frame = row.solution.trajectory, row.measurements.facts.frames.passes, warning.frame
    if warning.code != "camera-motion" or frame is None or frame not in row.problem.used:
        return False
    of_pass = np.array([passes[other] == passes[frame] for other in path.frames.tolist()])
    at = int(np.flatnonzero(path.frames[of_pass] == frame)[0])
    poses = path.world_from_rig[of_pass]
    forward = np.degrees(np.arctan2(poses[:, 0, 2], poses[:, 2, 2]))
    middle = np.median(wrapped(forward - forward[0])) + forward[0]
    turned = abs(float(wrapped(forward[at] - middle)))
    along, _, across = np.abs(poses[min(at + 1, len(poses) - 1), :3, 3] - poses[max(at - 1, 0), :3, 3])
    return turned < TURNED_DEG and bool(across < np.tan(np.radians(ASTRAY_DEG)) * along)


def _ends(row: DescribedRow) -> tuple[float, float]:
    """Where the row begins and ends along x: the face, which the locators find; without one it has no end."""
    face = [part.vertices[:, 0] for name in row.measurements.locators for part in row.structures.get(name, ())]
    face += [item.outline[:, 0] for item in row.uncertain if item.is_mapped]
    x = np.concatenate(face) if face else np.array([-np.inf, np.inf])
    return float(x.min()), float(x.max())


def _is_beyond(warning: MapWarning, row: DescribedRow) -> bool:
    """Whether all that a warning is about lies wholly beyond the row's ends: its subjects, or, of one that is about no
    elements, its place."""
    first, last = _ends(row)
    if warning.of_row and warning.place is not None:
        return not first <= warning.place[0] <= last
    along = [(part.id, part.vertices[:, 0]) for group in row.structures.values() for part in group]
    along += [(item.id, item.outline[:, 0]) for item in row.uncertain]
    return {name for name, x in along if x.max() < first or x.min() > last}.issuperset(warning.subjects or ("",))


def _uncertain_objects(objects: Sequence[FoundObject]) -> Iterator[MapWarning]:
    """A warning about each object that was found, and was not mapped: for want of certainty, or because no frame
    measured it."""
    for item in objects:
        x, y, z = item.outline.mean(axis=0).tolist()
        line = f"not mapped: a {item.label} at x {x:.2f}, y {y:.2f}, z {z:.2f} m"
        if item.is_mapped:
            yield MapWarning("uncertain-element", (item.id,), "found, but not measured", (x, y, z), details=(line,))
        elif item.probability > SURE:
            yield _unsure(item.id, item.probability, (x, y, z), line)


def _uncertain(structures: Sequence[Structure], support: Mapping[str, Support]) -> Iterator[MapWarning]:
    """A warning about each structure of which its plugin's model is not sure that it exists; about one of no such model
    that far fewer frames measured than should have, and than is usual for its label."""
    for structure in structures:
        probability = structure.attributes.get("probability")
        if isinstance(probability, float):
            if SURE < probability < 1 - SURE:
                yield _unsure(structure.id, probability, place_of(structure))
            continue
        alike = [support[other.id].share for other in structures if other.label == structure.label]
        frames = support[structure.id]
        limit = min(LEAST_SUPPORT, LEAST_OF_USUAL * float(np.median(alike)))
        if frames.expected >= LEAST_EXPECTED and frames.share < limit:
            figure, size = f"seen in {frames.seen} of {frames.expected} frames", 1 - frames.share
            yield MapWarning("uncertain-element", (structure.id,), figure, place_of(structure), size=size)


def _unsure(name: str, probability: float, place: tuple[float, float, float], *details: str) -> MapWarning:
    """The nearer to one half, the worse."""
    figure, size = f"P {probability:.2f}", min(probability, 1 - probability)
    return MapWarning("uncertain-element", (name,), figure, place, details=details, size=size)


def _inaccurate(structures: Sequence[Structure]) -> Iterator[MapWarning]:
    """A warning about each structure with a coordinate that is known less well than those of most of its label."""
    sigmas = {structure.id: _sigmas(structure) for structure in structures}
    for label in dict.fromkeys(structure.label for structure in structures):
        alike = [structure for structure in structures if structure.label == label]
        usual = np.median([sigmas[structure.id] for structure in alike], axis=0)
        for structure in alike:
            limits = np.clip(VAGUE * usual, VAGUE_M, UNKNOWN_M)
            vague = np.where(sigmas[structure.id] > limits, sigmas[structure.id], 0.0)
            if vague.any():
                worst = int(np.argmax(vague))
                accuracy = f"known to {100 * vague[worst]:.1f} cm" if vague[worst] < UNKNOWN_M else "not known"
                figure = f"{AXES[worst]} {accuracy}"
                yield MapWarning(
                    "inaccurate-element", (structure.id,), figure, place_of(structure), size=float(vague[worst])
                )


def _sigmas(structure: Structure) -> Floats:
    """The largest standard deviation (3,), m, of a structure's vertices along each axis, but of what its plugin says
    that it assumes."""
    variances = np.diagonal(structure.covariances, axis1=1, axis2=2)
    measured = np.where(structure.assumed("", None), 0.0, variances)
    return np.asarray(np.sqrt(measured.max(axis=0)))


def _unmapped(row: DescribedRow, plugin: LoadedPlugin) -> Iterator[MapWarning]:
    """A warning where nothing of a plugin is mapped in many of the frames that were taken before the face. These are
    dark or overexposed; or the plugin measured something, and each frame should show something of it, or nothing is
    mapped at all."""
    name, structures, path = plugin.name, row.structures.get(plugin.name, ()), row.solution.trajectory
    first, last = _ends(row)
    places = dict(zip(path.frames.tolist(), path.world_from_rig[:, 0, 3].tolist(), strict=True))
    frames = [frame for frame, tones in enumerate(row.measurements.tones) if name in tones]
    before = {
        frame: row.measurements.tones[frame][name] for frame in frames if first <= places.get(frame, first) <= last
    }
    unseen = {
        frame
        for frame, (dark, white) in before.items()
        if (white > GLARE if plugin.in_every_frame else dark + white > 1 - LEGIBLE)
    }
    measured = {feature.frame for feature in row.measurements.features.get(name, ())} & before.keys()
    shown = unseen | measured if plugin.in_every_frame or not structures else unseen
    tracks = row.tracks.get(name, ()) if structures else ()
    missed = sorted(shown.difference(*(track.frames.tolist() for track in tracks)))
    if len(missed) >= max(LEAST_EXPECTED, (UNMAPPED if structures else OFTEN_SEEN) * len(before)):
        figure = f"nothing mapped in {len(missed)} of {len(before)} frames"
        details = (f"{len(unseen.intersection(missed))} of these are overexposed or dark",)
        yield MapWarning("incomplete-map", (name,), figure, frame=missed[len(missed) // 2], details=details)


def _stretched(solution: Solution) -> Iterator[MapWarning]:
    """A warning where the solve with a vertical scale of the panoramas as one more unknown says that this is not 1."""
    error = solution.vertical_scale
    if error is None or abs(error.share) < max(STRETCHED, STRETCHED_SIGMA * error.sigma):
        return
    how = "large" if error.share > 0 else "small"
    figure = f"elevations {100 * abs(error.share):.2f} ± {100 * error.sigma:.2f} % too {how}"
    yield MapWarning("stretched-pictures", figure=figure, details=("heights and distances are wrong by it",))


def _bent(solution: Solution) -> Iterator[MapWarning]:
    """A warning where the solve with the lenses' distance as one more unknown says that the pictures are bent at their
    seam, which crosses the face."""
    error = solution.lens_distance
    if error is None or not error.significant:
        return
    figure = f"lenses {100 * error.distance_m:.1f} ± {100 * error.sigma_m:.1f} cm apart"
    yield MapWarning("lens-seam", figure=figure, details=("heights and distances are wrong by it",))


def _no_panorama(row: DescribedRow) -> Iterator[MapWarning]:
    """A warning where what locates the camera, and what another plugin measured, is off in the same directions of the
    camera in all frames, by angles that are none of measuring. Where it is what locates the camera alone, that may look
    different from aslant."""
    off = {
        plugin: errors.angle_deg
        for plugin, errors in row.solution.directional.items()
        if errors.angle_deg > OFF_DEG and errors.share > OFF_SHARE
    }
    if len(off) > 1 and off.keys() & row.measurements.locators:
        names = " and ".join(sorted(off))
        line = f"what was measured of {names} is off in the same directions of the camera in all frames"
        yield MapWarning("bad-panorama", figure=f"up to {max(off.values()):.2f} degrees off", details=(line,))


def _contradicted(structures: Sequence[Structure], solution: Solution, plugin: str) -> Iterator[MapWarning]:
    """A warning about each structure of whose measurements many were rejected, far from where it was mapped, or half
    are further off than those of its likes usually are: they are of no one thing."""
    landmarks = solution.landmarks_of(plugin)
    points = {
        structure.id: [landmark for name, landmark in landmarks.items() if is_of(name, structure.id)]
        for structure in structures
    }
    usual = {label: _usual_offset(structures, points, label) for label in {structure.label for structure in structures}}
    for structure in structures:
        offsets, limit = _offsets(points[structure.id]), max(SCATTERED_M, SCATTERED * usual[structure.label])
        rejected = sum(
            int((landmark.offsets[landmark.observations :] > FAR_M).sum()) for landmark in points[structure.id]
        )
        if rejected > MOST_REJECTED * len(offsets):
            figure = f"{rejected} of {len(offsets)} rejected"
        elif len(offsets) and np.median(offsets) > limit:
            figure = f"half over {100 * np.median(offsets):.1f} cm off"
        else:
            continue
        yield MapWarning("inconsistent-element", (structure.id,), figure, place_of(structure), size=FAR_M)


def _usual_offset(structures: Sequence[Structure], landmarks: Mapping[str, Sequence[Landmark]], label: str) -> float:
    """How far, m, the measurements of the structures of a label usually are off; `landmarks`: those of each structure,
    by its id."""
    offsets = _offsets(
        [point for structure in structures if structure.label == label for point in landmarks[structure.id]]
    )
    return float(np.median(offsets)) if len(offsets) else 0.0


def _offsets(landmarks: Sequence[Landmark]) -> Floats:
    """How far (n,) m the measurements of some landmarks are off."""
    return np.concatenate([np.zeros(0), *(landmark.offsets for landmark in landmarks)])


def place_of(structure: Structure) -> tuple[float, float, float]:
    """A structure's middle, m."""
    x, y, z = structure.vertices.mean(axis=0).tolist()
    return x, y, z
