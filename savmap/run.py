"""`savmap map`, `demo` and `evaluate`: functions that yield or return the lines to print."""

import json
from collections.abc import Iterator, Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

from savmap.errors import RowsFailedError, SavmapError, SiteError
from savmap.io.files import sha256, write_text
from savmap.job import Job, job_for, prepare, require_ready, rooms_for
from savmap.mapping import Way, mapped_rows
from savmap.rooms import Room, open_room
from savmap.runlog import RunLog, write_log
from savmap.store import file_name, locked
from savmap.types import RowMap, SiteMap

if TYPE_CHECKING:
    from savmap.evaluation import Evaluation
    from savmap.report.drawing import Drawing


def run(job: Job, way: Way | None = None) -> Iterator[str]:
    """Map all rows of a job into its folder; yields lines for the user.

    Everything that is given is checked first. What is worked out of each row is kept in the folder as soon as it is there; the other
    files are written whole, after everything is solved: map.json, run.json, site.resolved.json, pictures of each row. Raises RowsFailedError after that where
    some rows could not be mapped, and the first row's error where none could.
    """
    from savmap.console import Console

    require_ready(job)
    prepare(job.output)
    with locked(job.output), Console(job.output / "savmap.log") as console:
        mapped = mapped_rows(job, way or Way(), console)
        site_map = SiteMap(mapped.rows, made_by(job), {name: str(error) for name, error in mapped.failed.items()})
        yield from write_results(job, site_map, mapped.log)
        yield from scored(job)
        if mapped.failed:
            raise RowsFailedError(_failures(job, mapped.failed))


def _failures(job: Job, failed: Mapping[str, SavmapError]) -> str:
    names = ", ".join(failed)
    return (
        f"{len(failed)} of {len(job.site.rows)} rows could not be mapped: {names}; {job.output / 'map.json'} says why"
    )


def made_by(job: Job) -> dict[str, str]:
    """Versions of what made a map: savmap, GTSAM, onnxruntime and the networks' digests."""
    first = next(iter(job.site.rows))
    models = {f"model {room.name}": sha256(room.model) for room in rooms_for(job, first)}
    return {**{name: version(name) for name in ("savmap", "gtsam", "onnxruntime")}, **models}


def write_results(job: Job, site_map: SiteMap, log: RunLog) -> Iterator[str]:
    """Write the map, what was done for it, the resolved site, and each row's two pictures; yields a line for each file."""
    from savmap.io.mapfile import write_map
    from savmap.report.plots import write_face_view, write_plan_view

    write_map(site_map, job.output / "map.json")
    write_log(log, job.output / "run.json")
    write_text(job.output / "site.resolved.json", job.site.model_dump_json(indent=2, exclude_defaults=True) + "\n")
    yield f"wrote {job.output / 'map.json'}"
    survey = survey_rows(job)
    for name, row in site_map.rows.items():
        face, plan = (job.output / f"{kind}-{file_name(name)}.png" for kind in ("face", "plan"))
        drawings = drawings_of(rooms_for(job, name), row, survey.get(name))
        write_face_view(drawings, row, face)
        write_plan_view(drawings, row, plan)
        yield f"wrote {face} and {plan}"


def survey_rows(job: Job) -> Mapping[str, Mapping[str, Any]]:
    """The site's survey, row by row; empty when it names none."""
    from savmap.io.survey import read_survey

    return read_survey(job.site.survey).rows if job.site.survey else {}


def drawings_of(rooms: Sequence[Room], row: RowMap, survey: Mapping[str, Any] | None) -> "list[Drawing]":
    """What all rooms draw of a row, over its survey where there is one."""
    drawings: list[Drawing] = []
    for room in rooms:
        own = row.structures[room.name]
        deviations = room.evaluate(structures=own, survey=survey).deviations if survey is not None else {}
        drawings += room.draw(structures=own, survey=survey, deviations=deviations)
    return drawings


def scored(job: Job) -> Iterator[str]:
    """The scores against the site's survey and their box plot, where it names one."""
    if job.site.survey is not None:
        picture = job.output / "errors.png"
        evaluation = evaluate_files(job.output / "map.json", job.site.survey, picture)
        yield f"wrote {picture}"
        yield scores_table(evaluation)


def evaluate_files(map_file: Path, survey_file: Path, box_plot: Path | None = None) -> "Evaluation":
    """A map against a survey, scored by the plugins that made the map."""
    from savmap.evaluation import evaluate_site
    from savmap.io.mapfile import read_map
    from savmap.io.survey import read_survey
    from savmap.report.plots import write_box_plot

    site_map = read_map(map_file)
    names = dict.fromkeys(plugin for row in site_map.rows.values() for plugin in row.structures)
    rooms = {name: open_room(name, {}) for name in names}
    evaluation = evaluate_site(
        site_map,
        read_survey(survey_file),
        lambda name, own, survey: rooms[name].evaluate(structures=own, survey=survey),
    )
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
    from savmap.observe import preview as write_previews

    prepare(job.output)
    for name, row in job.site.rows.items():
        for path in write_previews(row.passes, rooms_for(job, name), job.output):
            yield f"row {name}: wrote {path}"


def demo(output: Path) -> Iterator[str]:
    """Map the footage of examples/aisle-dev, which lies beside the package in a clone of the repository."""
    places = [Path.cwd(), Path(__file__).resolve().parent.parent]
    found = next((p for place in places if (p := place / "examples" / "aisle-dev" / "site.yaml").is_file()), None)
    if found is None:
        raise SiteError("examples/aisle-dev/site.yaml: not found; run `savmap demo` in a clone of savmap's repository")
    yield from run(job_for(found, None, output))
