"""The verdict on a row's map: all that speaks against it, from every stage of its making."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from savmap.graph import Landmark, Solution
from savmap.pipeline.records import DescribedRow
from savmap.pipeline.trust.ends import without_beyond
from savmap.pipeline.trust.support import Support, is_of, supports
from savmap.types import Doubt, Floats, Structure, Verdict

LEAST_SUPPORT, LEAST_OF_USUAL, LEAST_EXPECTED = 0.2, 0.35, 5
DISAGREE_SIGMA, DISAGREE_M, HALVES = 4.0, 0.005, 2.0
OUTLIER, OUTLIER_M, TO_SIGMA, LEAST_USUAL = 5.0, 0.02, 1.48, 0.05
UNKNOWN_M = 0.05
"""A coordinate with a larger standard deviation was not measured: the height of a line that stands upright."""
MOST_REJECTED, FAR_M = 0.4, 0.01
"""A structure is doubted where a larger share of its measurements was rejected and is further from it than `FAR_M`. Nearer ones do not count: a structure is
not wrong by more than they are."""
SCATTERED_M, SCATTERED = 0.02, 4.0
"""A structure is doubted where the median distance of its measurements is larger than `SCATTERED_M`, and than `SCATTERED` times that of all structures of its
label: they are then of several things."""
OFTEN_SEEN = 0.5
OFF_DEG, OFF_SHARE = 0.02, 0.08
"""What a plugin measured is off in the camera's directions where it is so by a larger angle, which explains a larger share of its squared errors."""
STRETCHED_SIGMA, STRETCHED = 4.0, 0.002
"""A vertical scale is doubted that differs from 1 by more than so many standard deviations, and by more than such a share."""
AXES = "xyz"


def judge(row: DescribedRow) -> tuple[Mapping[str, tuple[Structure, ...]], Verdict]:
    """The row's structures by plugin, each with its `support`, and the verdict: what speaks against something beyond the row's ends is a note."""
    found: dict[str, tuple[Structure, ...]] = {}
    known = [*_stretched(row.solution), *_bent(row.solution)]
    doubts = [*row.measurements.doubts, *row.solution.doubts, *(known or _no_panorama(row))]
    for plugin in row.request.plugins:
        structures = row.structures.get(plugin.name, ())
        support = supports(structures, row.tracks.get(plugin.name, ()), row.solution.trajectory, row.measurements.facts)
        found[plugin.name] = tuple(_with_support(structure, support[structure.id]) for structure in structures)
        solution = row.solution, plugin.name
        doubts += [*_unmapped(row, plugin.name), *plugin.doubt(structures), *_weak(structures, support)]
        doubts += [*_unrepeatable(structures, *solution), *_contradicted(structures, *solution)]
    serious, minor = [one for one in doubts if not one.minor], [one.line for one in doubts if one.minor]
    kept, beyond = without_beyond(serious, found, row.measurements.locators)
    notes = (*row.solution.unchecked, *row.notes, *minor, *beyond)
    return found, Verdict(tuple(dict.fromkeys(kept)), tuple(dict.fromkeys(notes)))


def _with_support(structure: Structure, support: Support) -> Structure:
    return replace(structure, attributes={**structure.attributes, "support": round(support.share, 3)})


def _unmapped(row: DescribedRow, plugin: str) -> Iterator[Doubt]:
    """A doubt where a plugin measured something in most of the frames it looked at, and mapped nothing of it."""
    features, facts = row.measurements.features.get(plugin, ()), row.measurements.facts
    if row.structures.get(plugin) or plugin in row.measurements.locators:
        return
    views = {feature.view for feature in features}
    seen = len({feature.frame for feature in features})
    looked = sum(
        any(name.startswith(f"{of} / ") and facts.views[name].shows(frame) for name in views)
        for frame, of in enumerate(facts.frames.passes)
    )
    if seen >= max(LEAST_EXPECTED, OFTEN_SEEN * looked):
        figure, action = f"{seen} of {looked} frames", f"look whether all of it is missing: {plugin}"
        yield Doubt("support", "nothing is mapped of what frames show", figure=figure, action=action)


def _stretched(solution: Solution) -> Iterator[Doubt]:
    """A doubt where the solve with a vertical scale of the panoramas as one more unknown says that this is not 1."""
    error = solution.vertical_scale
    if error is None or abs(error.share) < max(STRETCHED, STRETCHED_SIGMA * error.sigma):
        return
    how = "large" if error.share > 0 else "small"
    yield Doubt(
        "camera",
        "the pictures were cropped or stretched",
        figure=f"elevations {100 * abs(error.share):.2f} ± {100 * error.sigma:.2f} % too {how}",
        action="export whole panoramas, or set `calibration: {vertical_scale: true}`",
        details=("heights and distances are wrong by it",),
    )


def _bent(solution: Solution) -> Iterator[Doubt]:
    """A doubt where the solve with the lenses' distance as one more unknown says that the pictures are bent at their seam, which crosses the face."""
    error = solution.lens_distance
    if error is None or not error.significant:
        return
    yield Doubt(
        "camera",
        "the pictures are bent at a seam",
        figure=f"lenses {100 * error.distance_m:.1f} ± {100 * error.sigma_m:.1f} cm apart",
        action="turn a lens towards the row, or set `calibration: {lens_distance: true}`",
        details=("the seam crosses the face: heights and distances are wrong by it",),
    )


def _no_panorama(row: DescribedRow) -> Iterator[Doubt]:
    """A doubt where what locates the camera, and what another plugin measured, is off in the same directions of the camera in all frames, by angles that
    are none of measuring; a minor one where it is what locates the camera alone, for that may look different from aslant."""
    off = {
        plugin: errors.angle_deg
        for plugin, errors in row.solution.directional.items()
        if errors.angle_deg > OFF_DEG and errors.share > OFF_SHARE
    }
    located = sorted(off.keys() & row.measurements.locators)
    if not located:
        return
    names, alone = " and ".join(sorted(off)), len(off) == 1
    line = f"what was measured of {names} is off in the same directions of the camera in all frames"
    yield Doubt(
        "camera",
        "the pictures may be no true panoramas",
        minor=alone,
        figure=f"up to {max(off.values()):.2f} degrees off",
        action="do not crop or stretch pictures, and turn a lens towards the row",
        details=(line, *(["or it looks different from aslant"] if alone else [])),
    )


def _weak(structures: Sequence[Structure], support: Mapping[str, Support]) -> Iterator[Doubt]:
    """A doubt about each structure that far fewer frames measured than should have, and than is usual for its label."""
    for structure in structures:
        alike = [support[other.id].share for other in structures if other.label == structure.label]
        own = support[structure.id]
        limit = min(LEAST_SUPPORT, LEAST_OF_USUAL * float(np.median(alike)))
        if own.expected >= LEAST_EXPECTED and own.share < limit:
            figure, action = f"{own.seen} of {own.expected} frames", f"look whether it is there: {structure.id}"
            what = "an element was measured in few frames"
            yield Doubt("support", what, (structure.id,), place_of(structure), figure=figure, action=action)


def _unrepeatable(structures: Sequence[Structure], solution: Solution, plugin: str) -> Iterator[Doubt]:
    """A doubt about each structure with a landmark that odd and even frames put in different places: by more than its uncertainty, or by
    far more than they do the plugin's other landmarks, for an uncertainty that all of them share hides what one of them has."""
    halves = [half for half in solution.halves if half.plugin == plugin]
    if not halves:
        return
    apart = np.abs([half.difference for half in halves])
    landmarks = solution.landmarks_of(plugin)
    sigmas = np.sqrt([np.diag(landmarks[half.name].covariance) for half in halves])
    strict = np.where(apart > DISAGREE_M, apart / (DISAGREE_SIGMA * HALVES * sigmas), 0.0)
    usual = np.where(apart > OUTLIER_M, apart / (_usual_limit(apart / sigmas) * sigmas), 0.0)
    excess = np.where(sigmas < UNKNOWN_M, np.maximum(strict, usual), 0.0)
    for structure in structures:
        own = [k for k, half in enumerate(halves) if is_of(half.name, structure.id)]
        if own and excess[own].max() > 1:
            worst = own[int(np.argmax(excess[own].max(axis=1)))]
            axis = int(np.argmax(excess[worst]))
            figure = f"{100 * apart[worst, axis]:.1f} cm apart"
            action = f"look whether it is one element: {structure.id}"
            details = (f"{halves[worst].name} along {AXES[axis]}",)
            said = None, False, figure, action, details
            what = "odd and even frames put an element apart"
            yield Doubt("repeatability", what, (structure.id,), place_of(structure), *said)


def _usual_limit(ratios: Floats) -> Floats:
    """The largest ratio (3,) of difference to standard deviation, axis by axis, that is no outlier among those of all landmarks (n, 3)."""
    return np.asarray(OUTLIER * np.maximum(TO_SIGMA * np.median(ratios, axis=0), LEAST_USUAL))


def _contradicted(structures: Sequence[Structure], solution: Solution, plugin: str) -> Iterator[Doubt]:
    """A doubt about each structure of whose measurements many were rejected, far from where it was mapped, or half are further off than those of its
    likes usually are: they are of no one thing."""
    landmarks = solution.landmarks_of(plugin)
    own = {
        structure.id: [landmark for name, landmark in landmarks.items() if is_of(name, structure.id)]
        for structure in structures
    }
    usual = {label: _usual_offset(structures, own, label) for label in {structure.label for structure in structures}}
    for structure in structures:
        offsets, limit = _offsets(own[structure.id]), max(SCATTERED_M, SCATTERED * usual[structure.label])
        rejected = sum(int((landmark.offsets[landmark.observations :] > FAR_M).sum()) for landmark in own[structure.id])
        if rejected > MOST_REJECTED * len(offsets):
            figure = f"{rejected} of {len(offsets)} rejected"
        elif len(offsets) and np.median(offsets) > limit:
            figure = f"half over {100 * np.median(offsets):.1f} cm off"
        else:
            continue
        what, action = "measurements of an element do not fit it", f"look whether it is one element: {structure.id}"
        yield Doubt("residuals", what, (structure.id,), place_of(structure), figure=figure, action=action)


def _usual_offset(structures: Sequence[Structure], landmarks: Mapping[str, Sequence[Landmark]], label: str) -> float:
    """How far, m, the measurements of the structures of a label usually are off; `landmarks`: those of each structure, by its id."""
    offsets = _offsets([one for structure in structures if structure.label == label for one in landmarks[structure.id]])
    return float(np.median(offsets)) if len(offsets) else 0.0


def _offsets(landmarks: Sequence[Landmark]) -> Floats:
    """How far (n,) m the measurements of some landmarks are off."""
    return np.concatenate([np.zeros(0), *(landmark.offsets for landmark in landmarks)])


def place_of(structure: Structure) -> tuple[float, float, float]:
    """A structure's middle, m."""
    x, y, z = structure.vertices.mean(axis=0).tolist()
    return x, y, z
