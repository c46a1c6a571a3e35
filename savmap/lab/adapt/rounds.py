"""One round: views labelled by the map, labels completed by a teacher, the network trained on these, the site mapped
with it, and whether that is better."""

import hashlib
import json
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from savmap.errors import SavmapError, SiteError, SolveError, StructureError
from savmap.files.atomic import read_json, write_text
from savmap.jobs.map_site import SiteRun, map_job_into
from savmap.jobs.scheduler import RunOptions
from savmap.lab.adapt.distillation import distilled
from savmap.lab.adapt.labels import HELD_OUT, LabelSets, write_labels
from savmap.lab.adapt.records import (
    AdaptOptions,
    Meter,
    RoundResult,
    State,
    job_with_network,
    job_without_lengths,
    mean,
)
from savmap.lab.train import TrainingPlan, train
from savmap.lab.train.plan import minutes_of, trained_classes
from savmap.maps.map_file import read_map
from savmap.site.job import Job, prepare
from savmap.types.progress import Monitor

RECIPE = 2
"""Rounds that another recipe began are begun anew."""
KEY, SCORES, RESULT, MAP = "key", "training.json", "round.json", "map"
TEACHER, DISTILLED = "teacher", "distilled-"
TEACHING = 0.4
"""The share of the time, or of the steps, in which the teacher learns."""
FORGETFUL = 4
"""The teacher is shown every fourth picture of other places."""
FORGOTTEN = 0.005
"""A network that has so much less intersection over union on pictures of other places than the one that the site began
with is not kept."""
FEWER = 0.01
"""A network with which the map has fewer structures that nothing warns of, by more than this share, is not kept. Two
equally good maps differ by less."""
INTEGERS = ".int8.onnx"


@dataclass(frozen=True, eq=False)
class Adaptation:
    """A site that teaches a plugin's network: the job, the plugin's name and its network's classes, the options, data
    sets against forgetting, where all is written, who is told, a data set of other places that nothing learns from."""

    job: Job
    plugin: str
    classes: Sequence[str]
    options: AdaptOptions
    replay: Sequence[Path]
    folder: Path
    monitor: Monitor
    meter: Meter
    others: Path | None = None

    def mapped(self, model: Path, trainable: Path, folder: Path) -> State:
        """The site's map with a network, made in a folder unless it is there. Rows in which a structure that a distance
        is given to is not found are mapped without distances. Raises SavmapError's kinds."""
        job = replace(job_with_network(self.job, self.plugin, model), output=folder)
        prepare(folder)
        run, failed = self._run(job)
        partial = {name: error for name, error in failed.items() if isinstance(error, SiteError)}
        if partial:
            self.monitor.note(f"mapping {', '.join(partial)} without distances: {next(iter(partial.values()))}")
            run, failed = self._run(job_without_lengths(job, partial))
        if run is None:
            raise next(iter(failed.values()))
        return State(model, trainable, folder / "map.json", run.site_map)

    def _run(self, job: Job) -> tuple[SiteRun | None, Mapping[str, SavmapError]]:
        """What mapping gave, if anything, and the errors of rows that could not be mapped; where none could, that of
        the first stands for all."""
        try:
            run = map_job_into(job, RunOptions(self.options.jobs), self.monitor)
        except SavmapError as error:
            return None, dict.fromkeys(job.site.rows, error)
        return run, run.failed_rows


def played(work: Adaptation, number: int, start: State, others_first: float | None = None) -> tuple[RoundResult, State]:
    """A round's result, and the network and map to go on with: the new ones if it is kept. A finished round is not
    played again. `others_first`: the intersection over union on other places of the network that the first round began
    with; None in that round."""
    folder = _folder_for(work, number, start)
    if (folder / RESULT).is_file():
        result = _read_result(folder / RESULT)
        return result, _state_of(work, folder, start) if result.kept else start
    job = job_with_network(work.job, work.plugin, start.model)
    sets = write_labels(job, work.plugin, start.site_map, work.options.views, folder, work.monitor)
    scores = _trained(work, folder, start, sets)
    result, state = _judged(work, number, folder, start, scores, others_first)
    state = state if result.kept else start
    result = replace(result, views=_pictures(sets.views), held_out=_pictures(sets.held_out))
    write_text(folder / RESULT, json.dumps(result.as_json(), indent=1) + "\n")
    return result, state


def _folder_for(work: Adaptation, number: int, start: State) -> Path:
    """A round's folder, emptied where what it was begun with has changed."""
    folder = work.folder / f"round-{number}"
    options = work.options
    replay = [str(path.resolve()) for path in work.replay]
    parts = [
        RECIPE,
        start.digest,
        options.minutes,
        options.steps,
        options.views,
        options.practice,
        replay,
        str(work.others),
        list(work.job.site.rows),
    ]
    key = hashlib.sha256(json.dumps(parts).encode()).hexdigest()
    key_file = folder / KEY
    if not key_file.is_file() or key_file.read_text(encoding="utf-8") != key:
        shutil.rmtree(folder, ignore_errors=True)
        prepare(folder)
        write_text(key_file, key)
    return folder


def _trained(work: Adaptation, folder: Path, start: State, sets: LabelSets) -> Mapping[str, Any]:
    """How well the network does on the views that are held out and on other places, before and after, by class. It is
    trained unless it is there.

    For `TEACHING` of the time the map teaches another network, which completes the map's labels. By these the network
    is trained. The other one is shown few pictures of other places: it may forget them, and sees the site's style the
    better for it.
    """
    (minutes, steps), rest = (_budget(work.options, share) for share in (TEACHING, 1 - TEACHING))
    teacher = TrainingPlan(
        trained_classes(work.classes, work.classes, start.trainable),
        [sets.views],
        folder / f"{TEACHER}.onnx",
        minutes,
        init=start.trainable,
        steps=steps,
        choose_by=[sets.choice],
        replay=work.replay,
        replay_every=FORGETFUL,
        one_site=True,
    )
    _lesson(work, teacher, folder / f"{TEACHER}.json", f"training a teacher of {work.plugin} by the map")
    with work.meter("labelling by the teacher, magnified") as progress:
        completed = {
            source: distilled(teacher.output, source, folder / f"{DISTILLED}{source.name}", teacher.classes, progress)
            for source in (sets.views, sets.choice)
        }
    measured = [sets.held_out, *([work.others] if work.others else [])]
    student = replace(
        teacher,
        data=[completed[sets.views]],
        choose_by=[completed[sets.choice]],
        output=folder / f"{work.plugin}.onnx",
        held_out=measured,
        minutes=rest[0],
        steps=rest[1],
        replay_every=1,
        int8=True,
    )
    scores = _lesson(work, student, folder / SCORES, f"training {work.plugin} by what the teacher sees")
    return {
        source.name: {
            when: {label: score["iou"][label] for label in work.classes} for when, score in scores[source.name].items()
        }
        for source in measured
    }


def _budget(options: AdaptOptions, share: float) -> tuple[float, int | None]:
    """The minutes, and the steps if these are given, of a share of a round's training."""
    steps = max(round(share * options.steps), 1) if options.steps else None
    return share * minutes_of(options.minutes, fine_tunes=True), steps


def _lesson(work: Adaptation, plan: TrainingPlan, scores_file: Path, doing: str) -> Mapping[str, Any]:
    """The scores of a training, which is done unless they are there."""
    if not scores_file.is_file():
        with work.meter(doing) as progress:
            network = train(plan, progress)
        write_text(scores_file, json.dumps(network.recipe["scores"], indent=1) + "\n")
    scores: Any = read_json(scores_file)
    return dict(scores)


def _judged(
    work: Adaptation, number: int, folder: Path, start: State, scores: Mapping[str, Any], others_first: float | None
) -> tuple[RoundResult, State]:
    """Whether a round is kept, by the views that are held out, by pictures of other places and by what the new map
    has."""
    trained = "int8" if _in_integers(start.model) else "after"
    before, after = scores[HELD_OUT]["before"], scores[HELD_OUT][trained]
    others = scores[work.others.name] if work.others else {"before": {}, trained: {}}
    structures = start.structures(work.plugin, work.classes)
    result = RoundResult(number, 0, 0, before, after, structures, None, False, "", others["before"], others[trained])
    if mean(after) <= mean(before):
        return replace(result, why="the network agrees no better with the map on views held out"), start
    if mean(result.others_after) < (mean(result.others_before) if others_first is None else others_first) - FORGOTTEN:
        return replace(result, why="the network does worse on pictures of other places"), start
    try:
        state = _state_of(work, folder, start, anew=True)
    except (StructureError, SolveError) as error:
        return replace(result, why=f"the site cannot be mapped with the new network: {error}"), start
    now = state.structures(work.plugin, work.classes)
    if len(state.site_map.rows) < len(start.site_map.rows):
        return replace(result, structures_after=now, why="fewer rows can be mapped with the new network"), start
    if state.sound(work.plugin, work.classes) < (1 - FEWER) * start.sound(work.plugin, work.classes):
        return replace(
            result, structures_after=now, why="the new map has fewer structures that nothing warns of"
        ), start
    return replace(result, structures_after=now, kept=True, why="the network agrees better with the map"), state


def _state_of(work: Adaptation, folder: Path, start: State, anew: bool = False) -> State:
    """The network of a round and its map, which is made or read."""
    trainable = folder / f"{work.plugin}.onnx"
    model = trainable.with_suffix(INTEGERS) if _in_integers(start.model) else trainable
    if anew:
        return work.mapped(model, trainable, folder / MAP)
    return State(model, trainable, folder / MAP / "map.json", read_map(folder / MAP / "map.json"))


def _in_integers(model: Path) -> bool:
    return model.name.endswith(INTEGERS)


def _read_result(path: Path) -> RoundResult:
    content: Any = read_json(path)
    try:
        return RoundResult(**content)
    except TypeError:
        raise SavmapError(f"{path}: is of another version; remove {path.parent}") from None


def _pictures(folder: Path) -> int:
    return len(list((folder / "images").iterdir()))
