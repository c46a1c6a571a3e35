"""What the commands `map` and `demo` do and print."""

import os
import shlex
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from savmap.assembly import alignment_lines, site_lines
from savmap.cli.console import Console
from savmap.cli.speech import say, say_all
from savmap.files.urls import is_url
from savmap.jobs.cache import locked
from savmap.jobs.map_site import MAP, failures_recorded, map_job_into, written_files
from savmap.jobs.preview import previews
from savmap.jobs.scheduler import RunOptions
from savmap.jobs.tasks import request_for
from savmap.maps.run_record import failed_since
from savmap.report.evaluation import as_table
from savmap.site.job import Job, prepare
from savmap.site.preflight import require_ready
from savmap.types import SiteMap


def map_and_print(job: Job, jobs: int | None = None, fresh: bool = False, cluster: str | None = None) -> None:
    """Map a job into its folder. Progress goes to standard error and `savmap.log`; the files that were written, the
    scores and the rows' places to standard output. Raises SavmapError; what could be mapped is written before. An
    interrupt says what is kept, and how to go on."""
    require_ready(job)
    prepare(job.output, written_files(job))
    with locked(job.output), going_on_told(job.output), Console(job.output / "savmap.log") as console:
        run = map_job_into(job, RunOptions(jobs, fresh, cluster), console)
        for file in run.files:
            say(f"wrote {file}")
        if run.evaluation is not None:
            say_all(as_table(run.evaluation))
        if run.changes is not None:
            say_all("\n".join(run.changes.lines()))
        placed = (*site_lines(run.site_map), *alignment_lines(run.site_map))
        for line in (*placed, *verdict_lines(run.site_map, job.output)):
            say(line)
        run.raise_if_incomplete(job)


@contextmanager
def going_on_told(output: Path) -> Iterator[None]:
    """Say, where what is done meanwhile is interrupted, what an output folder keeps and which command goes on from
    there."""
    try:
        yield
    except KeyboardInterrupt as interrupt:
        command = shlex.join(["savmap", *(word for word in sys.argv[1:] if word != "--fresh")])
        say(f"{output} keeps {str(interrupt) or 'all rows'}; go on with `{command}`", err=True)
        raise


@contextmanager
def failures_told(source: Path, output: Path) -> Iterator[None]:
    """Let the output folder's run.json tell where a run of a source fails, and say whose map is left there. A source
    that is not there was no run."""
    if is_url(output) or not (is_url(source) or os.path.exists(source)):
        yield
        return
    try:
        with failures_recorded(output):
            yield
    except Exception:
        if failed_since(output / MAP):
            say(f"{output / MAP} is of an earlier run", err=True)
        raise


def verdict_lines(site_map: SiteMap, folder: Path) -> Iterator[str]:
    """A line for each row's verdict, two for each warning, and one for its notes; last, where the details of warnings
    are."""
    verdicts = {row.name: row.verdict for row in site_map.rows.values() if row.verdict}
    for name, verdict in verdicts.items():
        yield f"row {name}: {verdict.grade}"
        for warning in verdict.warnings:
            what = f"{warning.headline}, {warning.figure}" if warning.figure else warning.headline
            yield f"  {warning.code}: {what}"
            yield f"    {warning.action}"
        if verdict.notes:
            more = len(verdict.notes) - 1
            others = f" (and {more} more note{'s' * (more > 1)} in the report)" if more else ""
            yield f"  note: {verdict.notes[0]}{others}"
    if any(verdict.warnings for verdict in verdicts.values()):
        yield f"details: {folder / 'report.html'}, {folder / MAP}, savmap view {folder}"


def preview_and_print(job: Job) -> None:
    """Write pictures of the views that plugins choose, one a pass. Raises SavmapError."""
    prepare(job.output)
    for note in job.notes:
        say(note)
    for name in job.site.rows:
        request = request_for(job, name)
        for path in previews(name, request.passes, request.plugins, job.output, request.attitudes):
            say(f"row {name}: wrote {path}")
