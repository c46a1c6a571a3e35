"""A job from its footage to a site map with its scores, and the files that are written of it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING

from savmap.assembly import assembled
from savmap.errors import PluginsLeftOutError, RowsFailedError, SavmapError
from savmap.files.atomic import file_name, sha256, write_text
from savmap.jobs.cache import FolderCache, NoCache, RowCache, locked
from savmap.jobs.cache_keys import drawing_key
from savmap.jobs.scheduler import RunOptions, map_rows_of
from savmap.jobs.tasks import request_for, warnings_as_notes
from savmap.maps.map_file import write_map
from savmap.maps.run_record import RunLog, write_log
from savmap.maps.survey import read_survey
from savmap.pipeline.measure import recordings
from savmap.plugin.isolation import failures_gathered
from savmap.site.job import Job, plugins_for, prepare
from savmap.site.layout import placements
from savmap.site.preflight import require_ready
from savmap.types import SiteMap
from savmap.types.progress import Monitor
from savmap.vision.networks.providers import runtime_version

if TYPE_CHECKING:
    from savmap.evaluation import Evaluation, Survey
    from savmap.plugin.manager import LoadedPlugin

DRAWN = "drawn"


@dataclass(frozen=True, eq=False)
class SiteRun:
    """What a run gave: the map, its scores where the site names a survey, what was done with each row, the rows that failed, the
    plugins that failed anywhere, and the files that were written."""

    site_map: SiteMap
    evaluation: "Evaluation | None"
    log: RunLog
    failed_rows: Mapping[str, SavmapError]
    failed_plugins: frozenset[str]
    files: tuple[Path, ...] = ()

    def raise_if_incomplete(self, job: Job) -> None:
        """Raises RowsFailedError where rows could not be mapped, PluginsLeftOutError where plugins failed."""
        if self.failed_rows:
            names = ", ".join(self.failed_rows)
            count = f"{len(self.failed_rows)} of {len(job.site.rows)}"
            raise RowsFailedError(f"{count} rows could not be mapped: {names}; {job.output / 'map.json'} says why")
        if self.failed_plugins:
            names = ", ".join(sorted(self.failed_plugins))
            raise PluginsLeftOutError(
                f"mapped without plugins that failed: {names}; {job.output / 'savmap.log'} says where and why"
            )


def map_job(job: Job, options: RunOptions, monitor: Monitor) -> SiteRun:
    """Map a job's rows, put them in one frame, and score them; nothing is written.

    Raises the first row's error where no row could be mapped, and SavmapError's kinds for what is wrong with the job.
    """
    require_ready(job)
    return _SiteMapping(job, options, monitor, NoCache()).run()


def map_job_into(job: Job, options: RunOptions, monitor: Monitor) -> SiteRun:
    """Map a job and write all its results into its output folder, which `prepare` has made.

    What is worked out of each row is kept in the folder as soon as it is there; the other files are written whole, after everything is
    solved. Raises as `map_job` does, and OutputError.
    """
    with locked(job.output):
        mapping = _SiteMapping(job, options, monitor, FolderCache(job.output, options.fresh))
        return mapping.run(write=True)


@dataclass(eq=False)
class _SiteMapping:
    """One run of a job."""

    job: Job
    options: RunOptions
    monitor: Monitor
    cache: RowCache

    @cached_property
    def plugins(self) -> Mapping[str, "LoadedPlugin"]:
        """The job's plugins by name, with the settings of its first row: for what concerns all rows."""
        first = next(iter(self.job.site.rows))
        return {plugin.name: plugin for plugin in plugins_for(self.job, first)}

    @cached_property
    def survey(self) -> "Survey | None":
        return read_survey(self.job.site.survey) if self.job.site.survey else None

    def run(self, write: bool = False) -> SiteRun:
        if self.job.note:
            self.monitor.note(self.job.note)
        mapped = map_rows_of(self.job, self.options, self.monitor, self.cache)
        failed = {name: str(error) for name, error in mapped.failed.items()}
        with failures_gathered() as failures, warnings_as_notes(self.monitor):
            site_map, notes = in_one_frame(self.job, SiteMap(mapped.rows, made_by(self.job), failed), self.plugins)
            for note in notes:
                self.monitor.note(note)
            evaluation = self._evaluate(site_map)
            files = self._write(site_map, mapped.log, evaluation) if write else ()
        failed_plugins = {name for row in mapped.log.rows.values() for name in row.plugins_failed}
        failed_plugins |= {failure.plugin for failure in failures}
        return SiteRun(site_map, evaluation, mapped.log, mapped.failed, frozenset(failed_plugins), files)

    def _evaluate(self, site_map: SiteMap) -> "Evaluation | None":
        from savmap.sitereport import evaluation_of

        return None if self.survey is None else evaluation_of(site_map, self.survey, self.plugins)

    def _write(self, site_map: SiteMap, log: RunLog, evaluation: "Evaluation | None") -> tuple[Path, ...]:
        raise NotImplementedError


def in_one_frame(
    job: Job, site_map: SiteMap, plugins: Mapping[str, "LoadedPlugin"]
) -> tuple[SiteMap, Sequence[str]]:
    """The map with its rows placed in the site's frame where something tells, and a line for each thing the user should know."""
    footage = {name: recordings(job.site.rows[name].passes) for name in site_map.rows}
    try:
        result = assembled(
            site_map,
            placements(job.site),
            footage,
            lambda plugin, structures: plugins[plugin].shared(structures=structures),
        )
    except SavmapError as error:
        return site_map, (f"rows are not placed in one frame: {error}",)
    return result.site_map, result.notes


def made_by(job: Job) -> dict[str, str]:
    """Versions of what made a map: savmap, GTSAM, onnxruntime and the networks' digests."""
    first = next(iter(job.site.rows))
    models = {f"model {plugin.name}": sha256(plugin.model_file) for plugin in plugins_for(job, first)}
    return {**{name: version(name) for name in ("savmap", "gtsam")}, "onnxruntime": runtime_version(), **models}
