"""The public `LiveSession`: a live session whose frames another program hands over."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from savmap.apps.live.rows import LiveRows
from savmap.apps.live.session import LiveMapping, LiveState, end_told
from savmap.apps.live.sources import recorded_job
from savmap.apps.live.streams import FrameRecorder
from savmap.errors import VideoError
from savmap.files.urls import where
from savmap.jobs.cache import locked
from savmap.jobs.map_site import made_by, map_job_into
from savmap.jobs.scheduler import RunOptions
from savmap.site.job import prepare
from savmap.site.overrides import overrides_of
from savmap.types import Panorama, SiteMap
from savmap.types.progress import Monitor, SilentMonitor

PathLike = str | Path


class LiveSession:
    """Maps one row while its panoramas are handed over; they are recorded into the output folder.

    site: a site file, of whose row the references and settings are taken; None: a row named "1" of which no more is
    given than `camera_height_m` and `side`. output: the folder that is written into. row: of the site file; default its
    first. plugins, overrides: as of `map_site`. split: several aisles are filmed, and `finish` maps the rows that
    `savmap split` finds in the recording. against: an earlier map, or its folder, in which the pass is recognised, and
    which it updates. resume: film on where an earlier session in this folder ended; both
    recordings are mapped in the end.

        with savmap.LiveSession("site.yaml", output="out") as session:
            for stamp_s, panorama in my_camera:
                state = session.add(stamp_s, panorama)
            site_map = session.finish()

    Raises SavmapError's kinds for what is wrong with site and output.
    """

    def __init__(
        self,
        site: PathLike | None = None,
        plugins: Sequence[str] | None = None,
        *,
        output: PathLike,
        row: str | None = None,
        camera_height_m: float | None = None,
        side: str | None = None,
        resume: bool = False,
        split: bool = False,
        against: PathLike | None = None,
        overrides: Sequence[str] = (),
    ) -> None:
        folder, keys = where(output), overrides_of(list(overrides), {})
        source = where(site) if site is not None else None
        self._splits = split
        self._job = recorded_job(source, plugins, folder, row, resume, camera_height_m, side, keys)
        self._job = self._job if against is None else self._job.coming_back(where(against))
        prepare(folder)
        self._mapping = LiveRows(self._job) if split else LiveMapping(self._job.walked, self._job.row)
        self._recorder = FrameRecorder(self._job.clip.path)
        self._next_s, self._frames, self._is_open = -np.inf, 0, True

    def add(self, stamp_s: float, panorama: NDArray[np.uint8]) -> LiveState:
        """Take a panorama (H, 2H, 3) uint8 RGB of a time in seconds, later than that of the one before; what to do, and
        how far the session is. It returns at once: measuring and mapping go on meanwhile.

        Raises VideoError for a picture that is no panorama, or a time that does not ascend; OutputError where it cannot
        be recorded; and the error by which measuring failed.
        """
        if panorama.dtype != np.uint8 or panorama.ndim != 3 or panorama.shape[1:] != (2 * len(panorama), 3):
            raise VideoError(f"a panorama is (H, 2H, 3) uint8 RGB, and this is {panorama.shape} {panorama.dtype}")
        self._recorder.write(stamp_s, panorama)
        if stamp_s >= self._next_s:
            self._next_s = stamp_s + 0.8 / self._job.clip.fps
            self._state = self._mapping.take(Panorama(self._frames, stamp_s, panorama))
            self._frames += 1
        return self._state

    def map(self) -> SiteMap | None:
        """The latest provisional map; None before the first."""
        maps = self._mapping.maps
        return SiteMap(dict(maps), made_by(self._job.walked)) if maps else None

    def finish(self, progress: Monitor | None = None) -> SiteMap:
        """End the session and map all that was recorded, as `map_site` does. Raises as that does."""
        self.close()
        monitor = progress or SilentMonitor()
        with end_told(self._job.recorded.output), locked(self._job.recorded.output):
            job = self._job.with_rows_found(monitor) if self._splits else self._job.recorded
            return map_job_into(job, RunOptions(0), monitor).site_map

    def close(self) -> None:
        """End the session; the recording and the latest provisional map stay."""
        if self._is_open:
            self._is_open = False
            self._recorder.close()
            self._mapping.stop()

    def __enter__(self) -> "LiveSession":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
