"""The job of a live session, and where its frames come from."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

from savmap.errors import SiteError
from savmap.site.job import Job, job_for
from savmap.site.model import Pass, Site
from savmap.site.overrides import Override
from savmap.types import Panorama
from savmap.video.clip import Clip, is_folder
from savmap.video.reader import panoramas
from savmap.video.streams import camera_frames, growing_folder, paced

RECORDING = "recording.mkv"


def live_job(
    source: Path,
    plugins: Sequence[str] | None,
    output: Path,
    row: str | None = None,
    camera: bool = False,
    camera_height_m: float | None = None,
    side: str | None = None,
    overrides: Sequence[Override] = (),
) -> tuple[Job, str]:
    """The job of one row in one pass, and the row's name. `source`: a site file, a video, or a folder of pictures, which
    may be empty yet. `camera`: the pass is what a camera's recording will hold.

    Raises SiteError for a bad site file, a row that it does not have, and one of several passes.
    """
    job = job_for(source, plugins, output, camera_height_m, side, None, overrides)
    name = row or next(iter(job.site.rows))
    if name not in job.site.rows:
        raise SiteError(f"{source}: has no row `{name}`; it has {', '.join(job.site.rows)}")
    passes = job.site.rows[name].passes
    if len(passes) > 1 and not camera:
        raise SiteError(f"{source}: row {name} has {len(passes)} passes; a live session films one (--row NAME)")
    only = passes[0].model_copy(update={"video": output / RECORDING, "start_s": 0.0, "end_s": None} if camera else {})
    return replace(job, site=_with_row(job, name, only)), name


def _with_row(job: Job, name: str, only: Pass) -> Site:
    row = job.site.rows[name].model_copy(update={"passes": (only,)})
    return job.site.model_copy(update={"rows": {name: row}})


def frames_of(clip: Clip, camera: str | None, pace: float, idle_s: float) -> Iterator[Panorama]:
    """The panoramas of a session, in order, as they come: of a camera, of a folder that grows, or of a file, `pace` times
    as fast as it was filmed. Raises VideoError, OutputError."""
    if camera is not None:
        return camera_frames(camera, clip.path, clip.fps)
    if is_folder(clip.path):
        return growing_folder(clip, idle_s)
    return paced(panoramas(clip), pace)
