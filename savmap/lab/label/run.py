"""`savmap label`: from recordings to the pictures most worth labelling, with the network's own masks to start from."""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import count as numbers
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from savmap.errors import SiteError, StructureError
from savmap.lab.label.formats import LabelledPicture, LabelledSet, require_unused, write_set
from savmap.lab.label.polygons import outlines
from savmap.lab.label.worth import SeenView, chosen, descriptor, disagreement, ranks, seen_view, uncertainty
from savmap.pipeline.view_plans import PassPlan, plan_pass
from savmap.plugin.manager import LoadedPlugin
from savmap.plugin.segmenters import SegmenterPool
from savmap.site.job import Job, job_for, plugins_for, prepare
from savmap.site.model import pass_names
from savmap.site.overrides import Override
from savmap.types import View, ViewSpec
from savmap.types.progress import Monitor, SilentMonitor
from savmap.video.clip import time_range
from savmap.video.reader import expected_frames, panoramas, probe_clip
from savmap.vision.networks.segmenter import Segmenter
from savmap.vision.views import Renderer

LOOKED_AT_EACH = 6
LEAST_LOOKED_AT = 60
TIME_WEIGHT, PASS_WEIGHT = 1.0, 0.3


@dataclass(eq=False)
class Candidate:
    """A view that might be labelled: of which recording and frame, how unsure the network is of it, what it looks
    like."""

    recording: int
    spec: ViewSpec
    frame: int
    uncertainty: float
    descriptor: NDArray[np.float64]
    disagreement: float = 0.0


@dataclass(frozen=True, eq=False)
class Recording:
    """A pass with the views of it that the plugin, opened for its row, wants; every `every`-th frame is looked at, and
    the one after it."""

    row: str
    loaded: LoadedPlugin
    aimed: PassPlan
    specs: Sequence[ViewSpec]
    frames: int
    every: int = 1


@dataclass(frozen=True, eq=False)
class ViewPredictor:
    """Renders views and asks the plugin's network about them."""

    segmenter: Segmenter
    classes: Sequence[str]
    renderer: Renderer = field(default_factory=Renderer)

    def maps(self, view: View) -> NDArray[np.float32]:
        """Probabilities (1 + classes, h, w) of the plugin's classes, what is left being background."""
        maps = self.segmenter.probabilities(view.image)
        shares = maps[[self.segmenter.classes.index(name) + 1 for name in self.classes]]
        return np.concatenate([np.clip(1 - shares.sum(axis=0, keepdims=True), 0, 1), shares])


def label(
    source: Path,
    plugin: str | None,
    count: int,
    output: Path,
    overrides: Sequence[Override] = (),
    monitor: Monitor | None = None,
) -> LabelledSet:
    """Choose `count` views of a site's or a video's recordings and write them with outlines.

    Raises SiteError, VideoError, PluginError or ModelError for what cannot be used, StructureError where no view is
    found, OutputError where labels are in the folder already.
    """
    monitor = monitor or SilentMonitor()
    require_unused(output)
    job = job_for(source, None, output, overrides=overrides)
    name = plugin_of(job, source, plugin)
    job = replace(job, plugins=list(dict.fromkeys([*job.plugins, name])))
    require_footage(job)
    prepare(output)
    recordings = aimed_recordings(job, name, count, monitor)
    predictors, classes = predictors_of(recordings), recordings[0].loaded.classes
    candidates = [
        candidate
        for number, predictor in enumerate(predictors)
        for candidate in candidates_of(number, recordings, predictor, monitor)
    ]
    picked = [candidates[index] for index in chosen(*worth_and_features(candidates, recordings), count)]
    monitor.note(f"looked at {len(candidates)} views, chose {len(picked)}")
    return write_set(output, classes, pictures(picked, recordings, predictors, monitor))


def plugin_of(job: Job, source: Path, plugin: str | None) -> str:
    """The plugin whose pictures are wanted. Raises SiteError where that is not clear."""
    if plugin is not None:
        return plugin
    if not job.site.plugins and len(job.plugins) > 1:
        raise SiteError(f"{source}: say whose pictures to label: --plugin {' or --plugin '.join(job.plugins)}")
    return job.plugins[0]


def require_footage(job: Job) -> None:
    """Raise PluginError or SiteError for plugins and settings, VideoError for a recording or time range, that cannot be
    used."""
    for name, row in job.site.rows.items():
        plugins_for(job, name)
        for clip in (row_pass.clip for row_pass in row.passes):
            time_range(clip, probe_clip(clip).duration_s)


def aimed_recordings(job: Job, plugin: str, count: int, monitor: Monitor) -> list[Recording]:
    """Every pass with the views that the plugin wants of it, if any. All plugins are asked, in their order: one may
    know where the face is, and another not. Raises StructureError where it wants none of any."""
    renderer, recordings = Renderer(), list[Recording]()
    for row, content in job.site.rows.items():
        opened = plugins_for(job, row)
        segmenters = SegmenterPool(opened)
        loaded = next(loaded for loaded in opened if loaded.name == plugin)
        for name, row_pass in zip(pass_names(content.passes), content.passes, strict=True):
            monitor.note(f"row {row}, {name}: aiming the views")
            aimed = plan_pass(name, row_pass, opened, segmenters, renderer, None)
            specs = [spec for (whose, _), spec in aimed.views().items() if whose == plugin]
            frames = expected_frames(aimed.clip, probe_clip(aimed.clip))
            recordings.append(Recording(row, loaded, aimed, specs, frames))
    total = sum(recording.frames * len(recording.specs) for recording in recordings)
    if total == 0:
        raise StructureError(
            f"{job.source}: `{plugin}` wants no views of it; aim them by hand (`views` in a site file)"
        )
    every = -(-total // max(LOOKED_AT_EACH * count, LEAST_LOOKED_AT))
    return [replace(recording, every=every) for recording in recordings if recording.specs]


def predictors_of(recordings: Sequence[Recording]) -> list[ViewPredictor]:
    """Each recording's: rows may have networks of their own. Recordings with one network share it."""
    segmenters: dict[object, SegmenterPool] = {}
    predictors = []
    for loaded in (recording.loaded for recording in recordings):
        network = loaded.model, tuple(sorted(loaded.class_names.items())), loaded.providers
        segmenters[network] = segmenters.get(network) or SegmenterPool([loaded])
        predictors.append(ViewPredictor(segmenters[network].network(loaded), loaded.classes))
    return predictors


def candidates_of(
    number: int, recordings: Sequence[Recording], predictor: ViewPredictor, monitor: Monitor
) -> Iterator[Candidate]:
    """The views of a recording, with what the network makes of each and whether it changes its mind in the next
    frame."""
    recording = recordings[number]
    before: dict[ViewSpec, tuple[Candidate, SeenView]] = {}
    doing = f"row {recording.row}, {recording.aimed.name}: looking"
    for panorama in monitor.each(panoramas(recording.aimed.clip), doing, recording.frames):
        if panorama.frame % recording.every > 1:
            continue
        for spec in recording.specs:
            view = predictor.renderer.render(panorama, spec)
            maps = predictor.maps(view)
            seen = seen_view(view.image, maps)
            if spec in before:
                candidate, earlier = before.pop(spec)
                candidate.disagreement = disagreement(earlier, seen)
                yield candidate
            if panorama.frame % recording.every == 0:
                shown = descriptor(view.image, maps)
                before[spec] = Candidate(number, spec, panorama.frame, uncertainty(maps), shown), seen
    yield from (candidate for candidate, _ in before.values())


def worth_and_features(
    candidates: Sequence[Candidate], recordings: Sequence[Recording]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """What each view promises (n,), 0..1, and what it looks like, with where and when it was taken (n, d)."""
    unsure = np.array([candidate.uncertainty for candidate in candidates])
    changed = np.array([candidate.disagreement for candidate in candidates])
    times = np.array([[candidate.frame / recordings[candidate.recording].frames] for candidate in candidates])
    origins = list(dict.fromkeys((candidate.recording, candidate.spec) for candidate in candidates))
    kinds = np.eye(len(origins))[[origins.index((candidate.recording, candidate.spec)) for candidate in candidates]]
    looks = np.array([candidate.descriptor for candidate in candidates])
    spread = max(float(np.sqrt(looks.var(axis=0).sum())), 1e-9)
    features = np.hstack([looks / spread, TIME_WEIGHT * times, PASS_WEIGHT * kinds])
    return (ranks(unsure) + ranks(changed)) / 2, features


def pictures(
    picked: Sequence[Candidate], recordings: Sequence[Recording], predictors: Sequence[ViewPredictor], monitor: Monitor
) -> Iterator[LabelledPicture]:
    """The chosen views with the outlines that the network sees in them, in the order of the recordings; no two of one
    name."""
    names = set[str]()
    for number, (recording, predictor) in enumerate(zip(recordings, predictors, strict=True)):
        wanted = {(candidate.frame, candidate.spec) for candidate in picked if candidate.recording == number}
        if not wanted:
            continue
        doing = f"row {recording.row}, {recording.aimed.name}: writing"
        for panorama in monitor.each(panoramas(recording.aimed.clip), doing, recording.frames):
            for spec in (spec for spec in recording.specs if (panorama.frame, spec) in wanted):
                view = predictor.renderer.render(panorama, spec)
                classes = predictor.maps(view).argmax(axis=0)
                shapes = {name: outlines(classes == value) for value, name in enumerate(predictor.classes, start=1)}
                stem = picture_name(recording.row, spec.name, panorama.frame)
                name = next(name for more in numbers() if (name := "x-" * more + stem) not in names)
                names.add(name)
                yield LabelledPicture(name, view.image, shapes)


def picture_name(row: str, view: str, frame: int) -> str:
    """Of a view's picture: "A-pass-1-face-00012"."""
    return "-".join(re.findall(r"\w+", f"{row} {view}")) + f"-{frame:05d}"
