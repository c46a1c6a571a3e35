"""What the engine checks of a hook's answer, beside its type and what its records refuse themselves when they are made
(`savmap.types`). Each check raises ValueError with the first fault it finds."""

import json
import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from savmap.types import (
    CrossRowLandmark,
    Detection,
    Feature,
    FlatParts,
    Floats,
    FoundObject,
    MapWarning,
    Measured,
    PlanePatch,
    RowFacts,
    RowInspection,
    Structure,
    Track,
    Trajectory,
    View,
    ViewSpec,
)

if TYPE_CHECKING:
    from savmap.graph import Constraints
    from savmap.types import Score, SurveyEntry


MOST_CELLS = 20_000_000
FARTHEST_M = 1e5
"""No vertex is further from its row's origin: a site file's places are bounded alike."""
ROUNDING = 1e-6
"""Of a covariance's largest variance: what solving and rounding to six digits leave."""


def require(condition: bool, fault: str) -> None:
    """Raise ValueError with the fault unless the condition holds."""
    if not condition:
        raise ValueError(fault)


def require_distinct(names: Iterable[str], what: str) -> None:
    """Raise ValueError where a name comes twice; `what` is called so, such as "views with the name"."""
    name, times = next(iter(Counter(names).most_common(1)), ("", 0))
    require(times <= 1, f"{times} {what} `{name}`")


def check_detections(detections: Sequence[Detection], view: View) -> None:
    """Masks of the view's size."""
    size = (view.spec.height, view.spec.width)
    for number, detection in enumerate(detections):
        where = f"detection {number} (`{detection.label}`)"
        require(detection.mask.shape == size, f"{where}: its mask is {detection.mask.shape}, its view {size}")


def check_features(features: Sequence[Feature], spec: ViewSpec, frame: int) -> None:
    """Features of the view's name and frame."""
    for number, feature in enumerate(features):
        where = f"feature {number} (`{feature.label}`, `{feature.part}`)"
        require(feature.frame == frame, f"{where}: it is of frame {feature.frame}, its view of frame {frame}")
        require(feature.view == spec.name, f"{where}: it is of view `{feature.view}`, not of `{spec.name}`")


def check_tracks(tracks: Sequence[Track], facts: RowFacts) -> None:
    """Tracks of different names, in frames and views of the row, with finite pixels and proper covariances."""
    require_distinct((track.name for track in tracks), "tracks with the name")
    for track in tracks:
        where = f"track `{track.name}`"
        frames = np.asarray(track.frames)
        require(frames.ndim == 1 and frames.dtype.kind in "iu", f"{where}: frames are not whole numbers (n,)")
        outside = frames[(frames < 0) | (frames >= len(facts.frames))].tolist()
        require(not outside, f"{where}: no frame {outside[:1]} in the row, which has {len(facts.frames)}")
        unknown = sorted(set(track.views) - set(facts.views))
        require(not unknown, f"{where}: no view `{''.join(unknown[:1])}` in the row")
        require(_finite(track.pixels), f"{where}: a pixel is not finite")
        _require_covariances(track.covariances, where)


def check_patches(patches: Sequence[PlanePatch]) -> None:
    """Patches of different names, of a size that memory holds."""
    require_distinct((patch.name for patch in patches), "planes with the name")
    for patch in patches:
        cells = patch.shape[0] * patch.shape[1]
        require(cells <= MOST_CELLS, f"plane `{patch.name}`: more than {MOST_CELLS} cells")


def check_found(objects: Sequence[FoundObject], classes: Sequence[str]) -> None:
    """Objects of different ids, with outlines of three corners or more, of the plugin's classes."""
    require_distinct((item.id for item in objects), "found objects with the id")
    for item in objects:
        where = f"found object `{item.id}`"
        require(item.label in classes, f"{where}: the plugin has no class `{item.label}`")
        require(len(item.outline) >= 3, f"{where}: an outline has three corners or more")


def check_flat_parts(flats: Sequence[FlatParts], points: Mapping[str, Floats]) -> None:
    """Parts of the plugin's own landmarks, and no two answers for one coordinate."""
    require_distinct((f"{flat.landmark}, {flat.axis}" for flat in flats), "answers for the depth of")
    for flat in flats:
        require(flat.landmark in points, f"flat parts at `{flat.landmark}`: the plugin has no such landmark")
        check_patches(flat.parts)


def check_constraints(constraints: "Constraints", name: str, start: Trajectory) -> None:
    """Finite pixels with proper covariances, and what `require_valid_constraints` asks for, which raises
    PluginFailedError."""
    from savmap.graph import require_valid_constraints  # keeps `savmap --help` fast

    require(_finite(constraints.measurements.pixels), "a measured pixel is not finite")
    _require_covariances(constraints.measurements.covariances, "measured pixels")
    require_valid_constraints(name, constraints, start)


def check_structures(structures: Sequence[Structure]) -> None:
    """Structures of different ids and with a vertex or more, whose numbers are finite and whose attributes go into
    map.json."""
    require_distinct((structure.id for structure in structures), "structures with the id")
    for structure in structures:
        where = f"structure `{structure.id}`"
        texts = (structure.id, structure.label, *structure.vertex_labels)
        require(all(isinstance(text, str) for text in texts), f"{where}: its id and labels are not all texts")
        _require_positions(structure, where)
        edges = np.asarray(structure.edges)
        require(edges.dtype.kind in "iu" or not edges.size, f"{where}: edges are not whole numbers (m, 2)")
        require(edges.ndim == 2 and edges.shape[1] == 2, f"{where}: edges are {edges.shape}, not (m, 2)")
        inside = (edges >= 0) & (edges < len(structure.vertices))
        require(bool(inside.all()), f"{where}: an edge joins a vertex that is not there")
        if structure.solid is not None:
            far = max(np.abs(structure.solid.outline).max(), np.abs(structure.solid.depth).max())
            require(far <= FARTHEST_M, f"{where}: a corner of its solid is more than {FARTHEST_M:g} m away")
            kind = structure.solid.ifc_class
            named = re.fullmatch("Ifc[A-Za-z0-9]{1,77}", kind)
            require(named is not None, f"{where}: {kind!r} is no class of IFC, such as IfcBeam")
        for name, value in structure.attributes.items():
            require(isinstance(name, str), f"{where}: the name {name!r} of an attribute is no text")
            number = isinstance(value, int | float | np.integer | np.floating)
            said = number or isinstance(value, str | Measured)
            require(said, f"{where}: attribute `{name}` is a {type(value).__name__}, no number or text")
            require(not number or _finite(value), f"{where}: attribute `{name}` is not finite")


def check_related(related: Sequence[Structure], structures: Sequence[Structure]) -> None:
    """The structures that were given, in the same order, still fit for map.json."""
    require(len(related) == len(structures), f"{len(related)} structures for {len(structures)}")
    for structure, before in zip(related, structures, strict=True):
        require(structure.id == before.id, f"structure `{structure.id}` in the place of `{before.id}`")
    check_structures(related)


def check_warnings(warnings: Sequence[MapWarning], structures: Sequence[Structure], name: str) -> None:
    """Every warning is about structures that there are, or about all that the plugin of this name maps."""
    ids = {name, *(structure.id for structure in structures)}
    for warning in warnings:
        others = sorted(set(warning.subjects) - ids)
        require(not others, f"a warning about {others}, which is not among the structures")


def check_inspection(inspection: RowInspection, structures: Sequence[Structure]) -> None:
    """Tables of different names, and parts to be shown of structures that were given."""
    ids = {structure.id for structure in structures}
    require_distinct((table.name for table in inspection.tables), "tables with the name")
    for part in inspection.close_ups:
        require(part.subject in ids, f"part `{part.title}`: no structure has the id `{part.subject}`")


def check_landmarks(landmarks: Sequence[CrossRowLandmark], structures: Sequence[Structure]) -> None:
    """Landmarks of structures that were given."""
    ids = {structure.id for structure in structures}
    require_distinct((landmark.id for landmark in landmarks), "landmarks with the id")
    for landmark in landmarks:
        require(landmark.id in ids, f"landmark `{landmark.id}`: no structure has that id")


def check_score(score: "Score") -> None:
    """Errors that can be averaged. A deviation may be infinite: the structure is spurious."""
    distances = {name: matches.distances_m for name, matches in score.distances.items()}
    for name, errors in {**score.errors, **score.coordinates, **distances}.items():
        require(_finite(errors), f"an error of `{name}` is not finite")
    for name, deviation in score.deviations.items():
        require(not np.isnan(deviation), f"the deviation of `{name}` is not a number")


def check_survey_entry(entry: "SurveyEntry", structures: Sequence[Structure]) -> None:
    """What goes into a survey file, about structures that were given."""
    unknown = sorted(set(entry.left_out) - {structure.id for structure in structures})
    require(not unknown, f"`{''.join(unknown[:1])}` is left out, which was not given")
    require(all(isinstance(key, str) for key in entry.values), "a key of a survey is no text")
    json.dumps(dict(entry.values), allow_nan=False)


def _finite(numbers: object) -> bool:
    given = np.asarray(numbers)
    return given.dtype.kind != "c" and bool(np.isfinite(given.astype(np.float64)).all())


def _require_covariances(covariances: Floats, where: str) -> None:
    """Covariances (n, 2, 2) that are finite and positive definite."""
    require(_finite(covariances), f"{where}: a covariance is not finite")
    positive = (covariances[:, 0, 0] > 0) & (np.linalg.det(covariances) > 0)
    require(bool(positive.all()), f"{where}: a covariance is not positive definite")


def _require_positions(structure: Structure, where: str) -> None:
    """Vertices within the map's bounds, and covariances that are ones, but for rounding."""
    require(len(structure.vertices) > 0, f"{where}: it has no vertex")
    require(_finite(structure.vertices), f"{where}: a vertex is not finite")
    near = np.abs(structure.vertices) <= FARTHEST_M
    require(bool(near.all()), f"{where}: a vertex is more than {FARTHEST_M:g} m away")
    covariances = structure.covariances
    require(_finite(covariances), f"{where}: a covariance is not finite")
    variances = np.diagonal(covariances, axis1=1, axis2=2)
    require(bool((variances >= 0).all()), f"{where}: a variance is negative")
    require(bool((variances <= FARTHEST_M**2).all()), f"{where}: a standard deviation is more than {FARTHEST_M:g} m")
    allowed = ROUNDING * variances.max(axis=1, initial=0.0)
    skew = np.abs(covariances - covariances.transpose(0, 2, 1)).max(axis=(1, 2), initial=0.0)
    require(bool((skew <= allowed).all()), f"{where}: a covariance is not symmetric")
    least = np.linalg.eigvalsh(covariances).min(axis=1, initial=0.0)
    require(bool((least >= -allowed).all()), f"{where}: a covariance has a negative eigenvalue")
