"""What the command `live` does and prints."""

from collections.abc import Iterable

from savmap.cli.console import Console
from savmap.cli.mapping import map_and_print
from savmap.cli.speech import say
from savmap.errors import VideoError
from savmap.jobs.cache import locked
from savmap.live.rows import LiveRows
from savmap.live.session import LiveMapping, LiveState
from savmap.live.sources import LiveJob
from savmap.site.job import Job, prepare
from savmap.types import Panorama

ARROWS = {"left": "<-", "right": "->", "back": "<<", "on": ">>", "": "  "}


def walk_and_print(job: LiveJob, frames: Iterable[Panorama], resume: bool, splits: bool = False) -> None:
    """Map a row while its frames come, then all that was recorded; `splits`: each aisle as a row, then the rows that
    are found in the recording. The advice of each moment goes to standard error, when it changes. An interrupt, or a
    source that is lost, ends the walk, and what was recorded is mapped."""
    prepare(job.walked.output)
    with locked(job.walked.output), _begun(job, resume, splits) as live:
        said, maps = "", 0
        try:
            for panorama in frames:
                state = live.take(panorama)
                said, maps = _spoken(state, said), _mapped(state, live.row, maps)
        except VideoError as error:
            if not said:
                raise
            say(f"{error}; mapping what was recorded", err=True)
        except KeyboardInterrupt:
            say("the walk ends; mapping all that was recorded (interrupt again to leave that out)", err=True)
    map_and_print(_with_rows_found(job) if splits else job.recorded)


def _begun(job: LiveJob, resume: bool, splits: bool) -> LiveRows | LiveMapping:
    if splits:
        return LiveRows(job)
    live = LiveMapping(job.walked, job.row, resume)
    if live.resumed:
        say(f"row {job.row}: what was measured in {live.resumed} frames is kept from an earlier session", err=True)
    return live


def _with_rows_found(job: LiveJob) -> Job:
    with Console(job.recorded.output / "savmap.log") as console:
        split = job.with_rows_found(console)
    say(f"rows that were filmed: {', '.join(split.site.rows)}", err=True)
    return split


def _spoken(state: LiveState, before: str) -> str:
    """Say what to do, where that is something new; what was said last."""
    first = state.advice[0] if state.advice else None
    text = first.text if first is not None else "Walk on."
    if text != before:
        severity, arrow = (first.severity, first.arrow) if first is not None else ("good", "on")
        say(f"{state.footage_s:6.1f} s  [{severity:9}] {ARROWS[arrow]} {text}", err=True)
    return text


def _mapped(state: LiveState, row: str, maps: int) -> int:
    """Say that there is a new map; how many there were."""
    if state.maps > maps:
        say(
            f"{state.footage_s:6.1f} s  row {row}: {state.elements} elements from {state.mapped_frames} of "
            f"{state.frames} frames, mapped in {state.map_s:.1f} s",
            err=True,
        )
    return state.maps
