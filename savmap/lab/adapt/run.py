"""`savmap adapt`: the site teaches its own network, without a label."""

import json
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from savmap.errors import SiteError, StructureError
from savmap.files.atomic import write_bytes, write_text
from savmap.files.urls import is_url
from savmap.jobs.cache import locked
from savmap.lab.adapt.faces import outlines_of
from savmap.lab.adapt.labels import HELD_OUT
from savmap.lab.adapt.practice import OTHER_SEED, OTHERS, practice_set
from savmap.lab.adapt.records import Adapted, AdaptOptions, Meter, RoundResult, State, job_of_rows, mean
from savmap.lab.adapt.rounds import INTEGERS, Adaptation, played
from savmap.lab.train import check_extra
from savmap.lab.train.data.sets import read_set, read_sets
from savmap.lab.train.plan import Progress, float_model, minutes_of
from savmap.maps.map_file import read_map
from savmap.site.job import Job, job_for, prepare
from savmap.site.overrides import Override
from savmap.site.preflight import require_ready
from savmap.types.progress import Monitor, SilentMonitor
from savmap.vision.networks.session import network_digest

FOLDER, FIRST, PRACTICE, OTHER_PLACES, REPORT = "adapted", "first", "practice", "other-places", "report.json"
SHOWN = ("map.json", "report.html", "face-*", "plan-*", "errors.png", "view.html")
VIEWED = ("face/*.js", "face/small/*.js", "pano/*.js", "joint/*.js")
"""What of the new map is copied beside the network; the viewer keeps its scripts in folders."""


@contextmanager
def silent_meter(doing: str) -> Iterator[Progress]:
    """Shows nothing."""
    yield lambda done, line: None


def adapt(
    source: Path,
    output: Path,
    options: AdaptOptions,
    overrides: Sequence[Override] = (),
    monitor: Monitor | None = None,
    meter: Meter = silent_meter,
) -> Adapted:
    """Map a site (or use the map in the output folder), train a plugin's network on views that the map labels, and map
    again, as long as that is better; all results are in `adapted` in the output folder. What is finished is not done
    again.

    Raises SiteError for URLs and options, StructureError where there is no map to learn from, SavmapError's other kinds
    as mapping and training do.
    """
    check_extra()
    minutes_of(options.minutes, fine_tunes=True)
    job = job_to_adapt(source, output, options, overrides)
    name = plugin_of(job, options.plugin)
    job = replace(job, plugins=list(dict.fromkeys([*job.plugins, name])))
    require_ready(job)
    opened = job.opened(next(iter(job.site.rows)), name)
    require_one_network(job, name)
    shown = monitor or SilentMonitor()
    read_sets(options.replay, opened.classes)
    model = opened.model
    trainable = float_model(model)
    folder = output / FOLDER
    prepare(folder)
    with locked(folder):
        base = Adaptation(job, name, opened.classes, options, options.replay, folder, shown, meter)
        first = first_state(base, model, opened.model_file, trainable, output / "map.json")
        work = _beside_other_places(base)
        results, state = _rounds(work, first)
        return _finished(work, first, state, results)


def _beside_other_places(work: Adaptation) -> Adaptation:
    """With pictures of other places against forgetting, unless some are given, and others that measure it."""

    def pictures(count: int, folder: str, *seed: int) -> Path | None:
        return practice_set(work.plugin, work.classes, count, work.folder / folder, work.monitor, *seed)

    practice = None if work.replay else pictures(work.options.practice, PRACTICE)
    others = pictures(OTHERS, OTHER_PLACES, OTHER_SEED)
    return replace(work, replay=[*work.replay, *([practice] if practice else [])], others=others)


def job_to_adapt(source: Path, output: Path, options: AdaptOptions, overrides: Sequence[Override]) -> Job:
    """The site's job with the wanted rows alone. Raises SiteError for what cannot be used, URLs among it."""
    if is_url(source) or is_url(output):
        raise SiteError(
            f"{source if is_url(source) else output}: adapting needs local files: copy the site and its footage"
        )
    job = job_of_rows(job_for(source, None, output, overrides=overrides), options.rows)
    for name, row in job.site.rows.items():
        remote = next((row_pass.video for row_pass in row.passes if is_url(row_pass.video)), None)
        if remote is not None:
            raise SiteError(f"row {name}: {remote}: adapting needs local files: copy the footage")
    return job if job.site.plugins or options.plugin is None else replace(job, plugins=[options.plugin])


def plugin_of(job: Job, named: str | None) -> str:
    """Whose network is to be taught. Raises SiteError where that is not clear."""
    if named is None and len(job.plugins) > 1:
        raise SiteError(f"{job.source}: say whose network to teach: --plugin {' or --plugin '.join(job.plugins)}")
    return named or job.plugins[0]


def require_one_network(job: Job, plugin: str) -> None:
    """Raise SiteError where rows use different networks."""
    models = {name: job.opened(name, plugin).model for name in job.site.rows}
    if len(set(models.values())) > 1:
        raise SiteError(f"{job.source}: rows use different networks of `{plugin}`; teach those of one with --row")


def first_state(work: Adaptation, model: Path, model_file: Path, trainable: Path, map_file: Path) -> State:
    """The network to begin with, and the map to learn from: the one in the output folder that the same network made
    (`model_file`), or a new one. Raises StructureError where that has no structures to learn from, and SavmapError's
    kinds where there is none."""
    rows = work.job.site.rows
    existing = read_map(map_file) if map_file.is_file() else None
    if (
        existing
        and existing.made_by.get(f"model {work.plugin}") == network_digest(model_file)
        and {*existing.rows, *existing.failed} >= {*rows}
    ):
        work.monitor.note(f"using {map_file}")
        mine = {name: row for name, row in existing.rows.items() if name in rows}
        state = State(model, trainable, map_file, replace(existing, rows=mine))
    else:
        state = work.mapped(model, trainable, work.folder / FIRST)
    structures = [
        structure for row in state.site_map.rows.values() for structure in row.structures.get(work.plugin, ())
    ]
    if not outlines_of(structures, work.classes):
        raise StructureError(
            f"{state.map_file}: has no outlines of `{work.plugin}` ({', '.join(work.classes)}) to learn from; "
            "see why it maps none"
        )
    return state


def _rounds(work: Adaptation, state: State) -> tuple[list[RoundResult], State]:
    """The rounds' results, up to the first that is not kept, and the best network with its map."""
    results: list[RoundResult] = []
    for number in range(1, work.options.rounds + 1):
        others_first = mean(results[0].others_before) if results else None
        result, state = played(work, number, state, others_first)
        results.append(result)
        work.monitor.note(f"round {number} is {'kept' if result.kept else 'not kept'}: {result.why}")
        if not result.kept:
            break
    return results, state


def _finished(work: Adaptation, first: State, state: State, results: Sequence[RoundResult]) -> Adapted:
    """Write the results beside one another."""
    kept = next((result for result in reversed(results) if result.kept), None)
    last = kept or results[-1]
    before = last.iou_before if last.number == 1 else _agreement(work, first.trainable, last.number)
    adapted = Adapted(
        work.plugin,
        tuple(results),
        tuple(_copied(work, state)) if kept else (),
        before,
        kept.iou_after if kept else before,
        first.structures(work.plugin, work.classes),
        state.structures(work.plugin, work.classes),
        work.folder / REPORT,
    )
    write_text(adapted.report, json.dumps(adapted.as_json(), indent=1) + "\n")
    return adapted


def _agreement(work: Adaptation, model: Path, number: int) -> dict[str, float]:
    """How well the first network agrees with a later round's map."""
    from savmap.lab.train.measure import score_file  # keeps `savmap --help` fast

    held_out = read_set(work.folder / f"round-{number}" / HELD_OUT, work.classes)
    return {name: round(iou, 4) for name, iou in score_file(model, held_out.samples, work.classes).iou.items()}


def _copied(work: Adaptation, state: State) -> Iterator[Path]:
    """The best network's files and its map's, copied to where they are looked for; those that the viewer loads are not
    told."""
    for source in (state.trainable, state.trainable.with_suffix(INTEGERS)):
        yield _copy(source, work.folder)
    shown = state.map_file.parent
    for pattern in SHOWN:
        for source in sorted(shown.glob(pattern)):
            yield _copy(source, work.folder)
    for pattern in VIEWED:
        for source in sorted(shown.glob(pattern)):
            _copy(source, work.folder / source.parent.relative_to(shown))


def _copy(source: Path, folder: Path) -> Path:
    write_bytes(folder / source.name, source.read_bytes())
    return folder / source.name
