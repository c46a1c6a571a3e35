"""Rows that begin and end by themselves: a walk through several aisles, of which each is mapped while it is filmed.

The rules are those of `savmap split`, asked again at each sample of what came so far. They choose what provisional maps
are of; in the end `savmap split` looks at the whole recording.
"""

from collections import deque
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from savmap.apps.live.session import LiveMapping, LiveState
from savmap.apps.live.sources import LiveJob
from savmap.apps.split.find import DEFAULTS
from savmap.apps.split.passes import find_passes
from savmap.apps.split.records import SplitSettings
from savmap.apps.split.straights import headings
from savmap.errors import VideoError
from savmap.pipeline.drive import numbered
from savmap.types import Panorama, RowMap
from savmap.video.clip import is_folder
from savmap.video.motion import FramePair, Motion, motion_of, small_grey

RECENT = 120
"""Samples that passes are looked for in, one a second: what is long past says nothing of the aisle now."""


class AisleWatch:
    """Whether the camera is in an aisle, from frames in order."""

    def __init__(self, settings: SplitSettings = DEFAULTS) -> None:
        self.settings = settings
        self.is_inside = False
        self._motions: deque[Motion] = deque(maxlen=RECENT)
        self._first: Panorama | None = None
        self._next_s = -np.inf

    def take(self, panorama: Panorama) -> bool:
        """Whether the camera is in an aisle, as far as the frames tell up to this one."""
        first = self._first
        if first is None:
            self._first = panorama if panorama.stamp_s >= self._next_s else None
        elif (gap_s := panorama.stamp_s - first.stamp_s) >= self.settings.apart_s:
            greys = (small_grey(frame, self.settings.width) for frame in (first, panorama))
            self._motions.append(motion_of(FramePair(first.stamp_s, gap_s, *greys)))
            self._first, self._next_s = None, first.stamp_s + self.settings.every_s
            self.is_inside = self._inside()
        return self.is_inside

    def _inside(self) -> bool:
        """A pass goes on until the rig has turned, or nothing was near for as long as `savmap split` joins over."""
        motions = list(self._motions)
        passes = find_passes(motions, self.settings).passes if len(motions) > 1 else ()
        if not passes:
            return False
        end_s, now_s = passes[-1].end_s, motions[-1].stamp_s
        if now_s - end_s <= self.settings.every_s:
            return True
        rig = headings(motions)
        turned = abs(rig[-1] - np.interp(end_s, [motion.stamp_s for motion in motions], rig))
        return self.is_inside and bool(now_s - end_s <= self.settings.gap_s and turned < self.settings.bend_deg)


class LiveRows:
    """A walk through several aisles, each of which is mapped as a row by a `LiveMapping`, called "1", "2" and so on.

    Raises VideoError for a folder of pictures, which `savmap split` does not take, else as `LiveMapping` does.
    """

    def __init__(self, job: LiveJob) -> None:
        if is_folder(job.clip.path):
            raise VideoError(f"{job.clip.path}: is a folder of pictures; --split takes a video or a camera")
        self._job, self._watch = job, AisleWatch()
        self._number, self._first, self._maps, self._begun_s = 1, 0, 0, np.nan
        self._live = self._mapping({})

    @property
    def row(self) -> str:
        """The name of the row that is filmed now."""
        return str(self._number)

    @property
    def maps(self) -> Mapping[str, RowMap]:
        """The latest provisional map of each row that has one."""
        return self._live.maps

    def take(self, panorama: Panorama) -> LiveState:
        """Take the next frame. Raises the error by which measuring failed."""
        self._begun_s = panorama.stamp_s if np.isnan(self._begun_s) else self._begun_s
        before, inside = self._watch.is_inside, self._watch.take(panorama)
        if before and not inside:
            self.stop()
            self._maps += self._live.state("stopped").maps
            self._number, self._first = self._number + 1, panorama.frame
            self._live = self._mapping(self.maps)
        state = self._live.take(numbered(panorama, panorama.frame - self._first), measures=inside)
        return self._of_walk(state, panorama.frame + 1, panorama.stamp_s - self._begun_s)

    def stop(self) -> None:
        """End the walk; the latest provisional maps stay."""
        self._live.stop()
        self._live.forget()

    def _mapping(self, others: Mapping[str, RowMap]) -> LiveMapping:
        return LiveMapping(self._job.renamed(self.row), self.row, others=others)

    def _of_walk(self, state: LiveState, frames: int, footage_s: float) -> LiveState:
        return replace(state, frames=frames, footage_s=round(footage_s, 3), maps=self._maps + state.maps)

    def __enter__(self) -> "LiveRows":
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()
