"""What the command `live` does and prints."""

from collections.abc import Iterable
from contextlib import nullcontext

from savmap.apps.exchange.recordings import MapRecorder
from savmap.apps.live.assistant import Advice
from savmap.apps.live.rows import LiveRows
from savmap.apps.live.session import LiveMapping, LiveState, end_told
from savmap.apps.live.sources import LiveJob
from savmap.cli.console import Console
from savmap.cli.mapping import map_and_print
from savmap.cli.speech import say
from savmap.errors import VideoError
from savmap.jobs.cache import locked
from savmap.site.job import prepare
from savmap.types import Panorama, SiteMap

RECORD = "live.mcap"
LEVELS = {"good": 2, "attention": 3, "stop": 4}
"""Levels of foxglove.Log: information, warning, error."""
ARROWS = {"left": "<-", "right": "->", "back": "<<", "on": ">>", "": "  "}


def walk_and_print(
    job: LiveJob, frames: Iterable[Panorama], resume: bool, splits: bool = False, records: bool = False
) -> None:
    """Map a row while its frames come, then all that was recorded; `splits`: each aisle as a row, then the rows that
    are found in the recording. The advice of each moment goes to standard error, when it changes; `records`: also into
    an MCAP file, with the maps. An interrupt, or a source that is lost, ends the walk, and what was recorded is
    mapped."""
    output = job.walked.output
    prepare(output)
    recording = MapRecorder(output / RECORD, chunked=False) if records else nullcontext()
    with locked(output), recording as recorder, _begun(job, resume, splits) as live:
        teller = _Teller(live, recorder)
        try:
            for panorama in frames:
                teller.tell(live.take(panorama))
        except VideoError as error:
            if not teller.said:
                raise
            say(f"{error}; mapping what was recorded", err=True)
        except KeyboardInterrupt:
            say("the walk ends; mapping all that was recorded (interrupt again to leave that out)", err=True)
    with end_told(output):
        whole = job.recorded
        if splits:
            with Console(output / "savmap.log") as console:
                whole = job.with_rows_found(console)
            say(f"rows that were filmed: {', '.join(whole.site.rows)}", err=True)
        map_and_print(whole)


def _begun(job: LiveJob, resume: bool, splits: bool) -> LiveRows | LiveMapping:
    if splits:
        return LiveRows(job)
    live = LiveMapping(job.walked, job.row, resume)
    if live.resumed:
        say(f"row {job.row}: what was measured in {live.resumed} frames is kept from an earlier session", err=True)
    return live


class _Teller:
    """Says what is new at each moment: what to do, and that there is a new map."""

    def __init__(self, live: LiveRows | LiveMapping, recorder: MapRecorder | None) -> None:
        self.live, self.recorder = live, recorder
        self.said, self._maps = "", 0

    def tell(self, state: LiveState) -> None:
        """Say what is new in a state."""
        first = state.advice[0] if state.advice else Advice("good", "good", "Walk on.", "on")
        if first.text != self.said:
            self.said = first.text
            say(f"{state.footage_s:6.1f} s  [{first.severity:9}] {ARROWS[first.arrow]} {first.text}", err=True)
            if self.recorder is not None:
                self.recorder.say(first.text, LEVELS[first.severity], state.footage_s)
        if state.maps > self._maps:
            self._maps = state.maps
            say(
                f"{state.footage_s:6.1f} s  row {self.live.row}: {state.elements} elements from {state.mapped_frames} "
                f"of {state.frames} frames, mapped in {state.map_s:.1f} s",
                err=True,
            )
            if self.recorder is not None:
                self.recorder.add(SiteMap(dict(self.live.maps), {}), state.footage_s)
