"""The job of a live session, and where its frames come from."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from savmap.apps.live.streams import camera_frames, growing_folder, paced
from savmap.apps.split.find import find
from savmap.apps.split.site_rows import rows_of
from savmap.errors import OutputError, SiteError
from savmap.maps.map_file import map_in
from savmap.site.job import Job, job_for
from savmap.site.model import Pass, Row
from savmap.site.overrides import Override
from savmap.site.preflight import earlier_map
from savmap.types import Panorama
from savmap.types.progress import Monitor
from savmap.video.clip import Clip, is_folder
from savmap.video.reader import panoramas

RECORDING, ENDING = "recording", ".mkv"


@dataclass(frozen=True, eq=False)
class LiveJob:
    """A live session's row by its name; `walked`: the job with the one pass that is filmed; `recorded`: the job with
    all that was filmed of it, which is mapped in the end; they differ where an earlier session filmed a part."""

    row: str
    walked: Job
    recorded: Job

    def coming_back(self, against: Path, row: str | None = None) -> "LiveJob":
        """The same session along a row that an earlier map has, which it updates; `row`: which one, if that is known.

        Raises SiteError for a map that is none, lacks the row, or lies in the session's folder.
        """
        mapped = map_in(against)
        job = replace(self.recorded, against=mapped, against_row=row)
        for problem in earlier_map(job):
            raise problem
        return replace(self, walked=replace(self.walked, against=mapped, against_row=row), recorded=job)

    def renamed(self, name: str) -> Job:
        """The job that is filmed, with this name for its row."""
        rows = {name: self.walked.site.rows[self.row]}
        return replace(self.walked, site=self.walked.site.model_copy(update={"rows": rows}))

    def with_rows_found(self, monitor: Monitor) -> Job:
        """The recorded job with a row for each side of each pass that `savmap split` finds in the recordings, in place
        of the one that was filmed; what the site file says of that row alone is left out.

        Raises StructureError where a recording shows no pass, VideoError where it is a folder of pictures.
        """
        rows = dict[str, Row]()
        count = 1
        for recorded in self.recorded.site.rows[self.row].passes:
            passes = find(recorded.video, monitor=monitor).passes
            rows |= rows_of(passes, recorded, count)
            count += len(passes)
        return replace(self.recorded, site=self.recorded.site.model_copy(update={"rows": rows}))

    @property
    def clip(self) -> Clip:
        """The footage of the session."""
        return self.walked.site.rows[self.row].passes[0].clip


def live_job(
    source: Path,
    plugins: Sequence[str] | None,
    output: Path,
    row: str | None = None,
    camera_height_m: float | None = None,
    side: str | None = None,
    overrides: Sequence[Override] = (),
) -> LiveJob:
    """The job of one row in one pass. `source`: a site file, a video, or a folder of pictures, which may be empty yet.

    Raises SiteError for a bad site file, a row that it does not have, and one of several passes.
    """
    job = job_for(source, plugins, output, camera_height_m, side, None, overrides)
    name = _row_of(job, row)
    passes = job.site.rows[name].passes
    if len(passes) > 1:
        raise SiteError(f"{source}: row {name} has {len(passes)} passes; a live session films one (--row NAME)")
    only = _with_passes(job, name, passes)
    return LiveJob(name, only, only)


def recorded_job(
    site: Path | None,
    plugins: Sequence[str] | None,
    output: Path,
    row: str | None = None,
    resume: bool = False,
    camera_height_m: float | None = None,
    side: str | None = None,
    overrides: Sequence[Override] = (),
) -> LiveJob:
    """The job of a row whose footage is recorded into the output folder; `site`: a site file, of whose row the first
    pass says how it is filmed; None for a row of which no more is given. `resume`: an earlier session's recording
    stays, and another is begun.

    Raises SiteError as `live_job` does, and OutputError where there is a recording that would be lost.
    """
    earlier = recordings(output)
    if earlier and not resume:
        raise OutputError(f"{earlier[0]}: is an earlier session's recording; go on with --resume, or choose another -o")
    path = output / (f"{RECORDING}-{len(earlier) + 1}{ENDING}" if earlier else f"{RECORDING}{ENDING}")
    job = job_for(site or path, plugins, output, camera_height_m, side, None, overrides)
    name = _row_of(job, row)
    first = job.site.rows[name].passes[0].model_copy(update={"start_s": 0.0, "end_s": None})
    passes = [first.model_copy(update={"video": footage}) for footage in (*earlier, path)]
    return LiveJob(name, _with_passes(job, name, passes[-1:]), _with_passes(job, name, passes))


def recordings(output: Path) -> list[Path]:
    """What sessions recorded in an output folder, in their order."""
    paths = [output / f"{RECORDING}{ENDING}"]
    while paths[-1].is_file():
        paths.append(output / f"{RECORDING}-{len(paths) + 1}{ENDING}")
    return paths[:-1]


def _row_of(job: Job, row: str | None) -> str:
    name = row or next(iter(job.site.rows))
    if name not in job.site.rows:
        raise SiteError(f"{job.source}: has no row `{name}`; it has {', '.join(job.site.rows)}")
    return name


def _with_passes(job: Job, name: str, passes: Sequence[Pass]) -> Job:
    row = job.site.rows[name].model_copy(update={"passes": tuple(passes)})
    return replace(job, site=job.site.model_copy(update={"rows": {name: row}}))


def frames_of(clip: Clip, camera: str | None, pace: float, idle_s: float) -> Iterator[Panorama]:
    """The panoramas of a session, in order, as they come: of a camera, of a folder that grows, or of a file, `pace`
    times as fast as it was filmed. Raises VideoError, OutputError."""
    if camera is not None:
        return camera_frames(camera, clip.path, clip.fps)
    if is_folder(clip.path):
        return growing_folder(clip, idle_s)
    return paced(panoramas(clip), pace)
