"""`savmap map`, `demo` and `evaluate`: functions that yield or return the lines to print."""

import json
from collections.abc import Iterator, Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING

from savmap.errors import PluginsLeftOutError, RowsFailedError, SavmapError, SiteError
from savmap.files.atomic import sha256, write_text
from savmap.jobs.cache import Store, file_name, locked
from savmap.jobs.cache_keys import drawing_key
from savmap.jobs.scheduler import RunOptions, mapped_rows
from savmap.jobs.tasks import warnings_as_notes
from savmap.maps.run_record import RunLog, write_log
from savmap.maps.survey import read_survey
from savmap.plugin.isolation import failures_gathered
from savmap.site import preflight
from savmap.site.job import Job, job_for, plugins_for, prepare, skips
from savmap.sitereport import drawings_of, evaluation_of, plugins_of_map, report_for
from savmap.types import RowMap, SiteMap
from savmap.vision.networks.providers import runtime_version

DRAWN = "drawn"

if TYPE_CHECKING:
    from savmap.evaluation import Evaluation
    from savmap.report.drawing import Drawing


def run(job: Job, way: RunOptions | None = None) -> Iterator[str]:
    """Map all rows of a job into its folder; yields lines for the user.

    Everything that is given is checked first. What is worked out of each row is kept in the folder as soon as it is there; the other
    files are written whole, after everything is solved: map.json, run.json, report.html, site.resolved.json, pictures of each row. Raises
    RowsFailedError after that where some rows could not be mapped, PluginsLeftOutError where plugins failed and the site file wants all
    else to be mapped, and the first row's error where no row could be.
    """
    from savmap.assembly import site_lines
    from savmap.cli.console import Console

    way = way or RunOptions()
    preflight.require_ready(job)
    prepare(job.output)
    with locked(job.output), Console(job.output / "savmap.log") as console:
        if job.note:
            console.note(job.note)
        mapped = mapped_rows(job, way, console)
        failed = {name: str(error) for name, error in mapped.failed.items()}
        with failures_gathered() as failures, warnings_as_notes(console):
            site_map, notes = in_one_frame(job, SiteMap(mapped.rows, made_by(job), failed))
            for note in notes:
                console.note(note)
            yield from write_results(job, site_map, mapped.log, way)
            yield from scored(job)
        yield from site_lines(site_map)
        if mapped.failed:
            raise RowsFailedError(_failures(job, mapped.failed))
        lacking = {name for row in mapped.log.rows.values() for name in row.plugins_failed}
        if lacking or failures:
            names = ", ".join(sorted(lacking | {failure.plugin for failure in failures}))
            raise PluginsLeftOutError(
                f"mapped without plugins that failed: {names}; {job.output / 'savmap.log'} says where and why"
            )


def in_one_frame(job: Job, site_map: SiteMap) -> tuple[SiteMap, Sequence[str]]:
    """The map with its rows placed in the site's frame where something tells, and a line for each thing the user should know."""
    from savmap.assembly import assembled
    from savmap.pipeline.measure import recordings
    from savmap.site.layout import placements

    priors, plugins = placements(job.site), plugins_of_map(site_map, skips(job))
    footage = {name: recordings(job.site.rows[name].passes) for name in site_map.rows}
    try:
        found = assembled(site_map, priors, footage, lambda plugin, own: plugins[plugin].cross_row_landmarks(own))
    except SavmapError as error:
        return site_map, (f"rows are not placed in one frame: {error}",)
    return found.site_map, found.notes


def _failures(job: Job, failed: Mapping[str, SavmapError]) -> str:
    names = ", ".join(failed)
    return (
        f"{len(failed)} of {len(job.site.rows)} rows could not be mapped: {names}; {job.output / 'map.json'} says why"
    )


def made_by(job: Job) -> dict[str, str]:
    """Versions of what made a map: savmap, GTSAM, onnxruntime and the networks' digests."""
    first = next(iter(job.site.rows))
    models = {f"model {plugin.name}": sha256(plugin.model_file) for plugin in plugins_for(job, first)}
    return {**{name: version(name) for name in ("savmap", "gtsam")}, "onnxruntime": runtime_version(), **models}


def write_results(job: Job, site_map: SiteMap, log: RunLog, way: RunOptions) -> Iterator[str]:
    """Write the map, what was done for it, the resolved site, the report, and each row's two pictures; yields a line for each."""
    from savmap.maps.map_file import write_map

    write_map(site_map, job.output / "map.json")
    write_log(log, job.output / "run.json")
    write_text(job.output / "site.resolved.json", job.site.model_dump_json(indent=2, exclude_none=True) + "\n")
    yield f"wrote {job.output / 'map.json'}"
    survey = read_survey(job.site.survey) if job.site.survey else None
    sheets = survey.rows if survey else {}
    store = Store(job.output, way.fresh)
    for name, row in site_map.rows.items():
        print_ = drawing_key(site_map, name, sheets.get(name))
        pictures = [job.output / f"{kind}-{file_name(name)}.png" for kind in ("face", "plan")]
        if store.kept(name, DRAWN, print_) is None or not all(picture.is_file() for picture in pictures):
            plugins = plugins_for(job, name)
            draw(drawings_of(plugins, row, sheets.get(name)), row, *pictures)
            if not any(plugin.failure for plugin in plugins):
                store.keep(name, DRAWN, print_, b"")
        yield f"wrote {pictures[0]} and {pictures[1]}"
    report_for(site_map, job.output / "report.html", log, survey, _title(job.source), skips(job))
    yield f"wrote {job.output / 'report.html'}"


def _title(source: Path) -> str:
    """What a report is called: the file's name, or its folder's where that says no more than what it is."""
    return source.absolute().parent.name if source.stem == "site" else source.stem


def draw(drawings: "Sequence[Drawing]", row: RowMap, face: Path, plan: Path) -> None:
    """A row's two pictures."""
    from savmap.report.plots import write_face_view, write_plan_view

    write_face_view(drawings, row, face)
    write_plan_view(drawings, row, plan)


def scored(job: Job) -> Iterator[str]:
    """The scores against the site's survey and their box plot, where it names one."""
    if job.site.survey is not None:
        picture = job.output / "errors.png"
        evaluation = evaluate_files(job.output / "map.json", job.site.survey, picture, skips(job))
        yield f"wrote {picture}"
        yield scores_table(evaluation)


def evaluate_files(map_file: Path, survey_file: Path, box_plot: Path | None = None, skip: bool = False) -> "Evaluation":
    """A map against a survey, scored by the plugins that made the map; `skip`: without a plugin that fails."""
    from savmap.maps.map_file import read_map
    from savmap.report.plots import write_box_plot

    site_map = read_map(map_file)
    evaluation = evaluation_of(site_map, read_survey(survey_file), plugins_of_map(site_map, skip))
    if box_plot is not None:
        write_box_plot(evaluation, box_plot)
    return evaluation


def scores_json(evaluation: "Evaluation") -> str:
    """The scores as one JSON object."""
    from savmap.evaluation import as_json

    return json.dumps(as_json(evaluation), indent=2)


def scores_table(evaluation: "Evaluation") -> str:
    """The scores as a table for people."""
    from savmap.evaluation import as_table

    return as_table(evaluation)


def preview(job: Job) -> Iterator[str]:
    """Write pictures of the views that the aim chooses; yields a line for each."""
    from savmap.jobs.tasks import row_of
    from savmap.pipeline.initial_poses import initial_attitudes
    from savmap.pipeline.preview import previews

    prepare(job.output)
    yield from [job.note] if job.note else []
    for name, row in job.site.rows.items():
        attitudes = initial_attitudes(row_of(job, name))
        for path in previews(name, row.passes, plugins_for(job, name), job.output, attitudes):
            yield f"row {name}: wrote {path}"


def demo(output: Path) -> Iterator[str]:
    """Map the footage of examples/aisle-dev, which lies beside the package in a clone of the repository."""
    places = [Path.cwd(), Path(__file__).resolve().parent.parent]
    found = next((p for place in places if (p := place / "examples" / "aisle-dev" / "site.yaml").is_file()), None)
    if found is None:
        raise SiteError("examples/aisle-dev/site.yaml: not found; run `savmap demo` in a clone of savmap's repository")
    yield from run(job_for(found, None, output))
