"""`savmap map`, `demo` and `evaluate`: functions that yield or return the lines to print."""

import json
from collections.abc import Iterator, Mapping, Sequence
from importlib.metadata import version
from pathlib import Path

from savmap import checks
from savmap.contained import failures_gathered
from savmap.errors import PluginsLeftOutError, RowsFailedError, SavmapError, SiteError
from savmap.fingerprint import drawn_print
from savmap.io.files import sha256, write_text
from savmap.io.survey import read_survey
from savmap.job import Job, job_for, prepare, rooms_for, skips
from savmap.mapping import Way, mapped_rows
from savmap.report.page import write_page
from savmap.report.site_report import evaluation_of, report_for, rooms_of
from savmap.runlog import RunLog, write_log
from savmap.stages.networks.providers import runtime_version
from savmap.store import Store, file_name, locked
from savmap.types import Drawing, Evaluation, RowMap, SiteMap
from savmap.work import warnings_told

DRAWN = "drawn"


def run(job: Job, way: Way | None = None) -> Iterator[str]:
    """Map all rows of a job into its folder; yields lines for the user.

    Everything that is given is checked first. What is worked out of each row is kept in the folder as soon as it is there; the other
    files are written whole, after everything is solved: map.json, run.json, report.html, site.resolved.json, pictures of each row. Raises
    RowsFailedError after that where some rows could not be mapped, PluginsLeftOutError where plugins failed and the site file wants all
    else to be mapped, and the first row's error where no row could be.
    """
    from savmap.assembly import site_lines
    from savmap.console import Console

    way = way or Way()
    checks.require_ready(job)
    prepare(job.output)
    with locked(job.output), Console(job.output / "savmap.log") as console:
        if job.note:
            console.note(job.note)
        mapped = mapped_rows(job, way, console)
        failed = {name: str(error) for name, error in mapped.failed.items()}
        with failures_gathered() as failures, warnings_told(console):
            site_map, notes = in_one_frame(job, SiteMap(mapped.rows, made_by(job), failed))
            for note in notes:
                console.note(note)
            yield from write_results(job, site_map, mapped.log, way)
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
    from savmap.observe import recordings
    from savmap.placing import placements

    priors, rooms = placements(job.site), rooms_of(site_map, skips(job))
    footage = {name: recordings(job.site.rows[name].passes) for name in site_map.rows}
    try:
        found = assembled(site_map, priors, footage, lambda plugin, own: rooms[plugin].shared(structures=own))
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
    models = {f"model {room.name}": sha256(room.model_file) for room in rooms_for(job, first)}
    return {**{name: version(name) for name in ("savmap", "gtsam")}, "onnxruntime": runtime_version(), **models}


def write_results(job: Job, site_map: SiteMap, log: RunLog, way: Way) -> Iterator[str]:
    """Write the map, what was done for it, the resolved site, the report, each row's two pictures, and the box plot where there is a
    survey; yields a line for each, and the scores."""
    from savmap.io.mapfile import write_map

    write_map(site_map, job.output / "map.json")
    write_log(log, job.output / "run.json")
    write_text(job.output / "site.resolved.json", job.site.model_dump_json(indent=2, exclude_none=True) + "\n")
    yield f"wrote {job.output / 'map.json'}"
    survey = read_survey(job.site.survey) if job.site.survey else None
    sheets = survey.rows if survey else {}
    plugins = rooms_of(site_map, skips(job))
    report = report_for(site_map, plugins, survey, log, _title(job.source))
    store = Store(job.output, way.fresh)
    for name, row in site_map.rows.items():
        print_ = drawn_print(site_map, name, sheets.get(name))
        pictures = [job.output / f"{kind}-{file_name(name)}.png" for kind in ("face", "plan")]
        if store.kept(name, DRAWN, print_) is None or not all(picture.is_file() for picture in pictures):
            draw(report.drawings[name], row, *pictures)
            if not any(plugin.failure for plugin in plugins.values()):
                store.keep(name, DRAWN, print_, b"")
        yield f"wrote {pictures[0]} and {pictures[1]}"
    write_page(report, job.output / "report.html")
    yield f"wrote {job.output / 'report.html'}"
    if survey is not None:
        yield from scored(report.evaluation or evaluation_of(site_map, survey, plugins), job.output / "errors.png")


def _title(source: Path) -> str:
    """What a report is called: the file's name, or its folder's where that says no more than what it is."""
    return source.absolute().parent.name if source.stem == "site" else source.stem


def draw(drawings: Sequence[Drawing], row: RowMap, face: Path, plan: Path) -> None:
    """A row's two pictures."""
    from savmap.report.picture import write_row_view

    write_row_view(row, drawings, "face", face)
    write_row_view(row, drawings, "plan", plan)


def scored(evaluation: Evaluation, box_plot: Path) -> Iterator[str]:
    """Write the box plot of the scores; yields the lines about them."""
    from savmap.report.picture import write_box_plot

    write_box_plot(evaluation, box_plot)
    yield f"wrote {box_plot}"
    yield scores_table(evaluation)


def evaluate_files(map_file: Path, survey_file: Path, box_plot: Path | None = None) -> Evaluation:
    """A map against a survey, scored by the plugins that made the map."""
    from savmap.io.mapfile import read_map
    from savmap.report.picture import write_box_plot

    site_map = read_map(map_file)
    evaluation = evaluation_of(site_map, read_survey(survey_file), rooms_of(site_map))
    if box_plot is not None:
        write_box_plot(evaluation, box_plot)
    return evaluation


def scores_json(evaluation: Evaluation) -> str:
    """The scores as one JSON object."""
    from savmap.report.evaluation import as_json

    return json.dumps(as_json(evaluation), indent=2)


def scores_table(evaluation: Evaluation) -> str:
    """The scores as a table for people."""
    from savmap.report.evaluation import as_table

    return as_table(evaluation)


def preview(job: Job) -> Iterator[str]:
    """Write pictures of the views that the aim chooses; yields a line for each."""
    from savmap.paths import first_attitudes
    from savmap.preview import previews
    from savmap.work import row_of

    prepare(job.output)
    yield from [job.note] if job.note else []
    for name, row in job.site.rows.items():
        attitudes = first_attitudes(row_of(job, name))
        for path in previews(name, row.passes, rooms_for(job, name), job.output, attitudes):
            yield f"row {name}: wrote {path}"


def demo(output: Path) -> Iterator[str]:
    """Map the footage of examples/aisle-dev, which lies beside the package in a clone of the repository."""
    places = [Path.cwd(), Path(__file__).resolve().parent.parent]
    found = next((p for place in places if (p := place / "examples" / "aisle-dev" / "site.yaml").is_file()), None)
    if found is None:
        raise SiteError("examples/aisle-dev/site.yaml: not found; run `savmap demo` in a clone of savmap's repository")
    yield from run(job_for(found, None, output))
