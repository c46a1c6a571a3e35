"""Provisional maps, made in a process of their own: the solver holds Python's lock, and the walk must not wait for it.

The process is told which views the walk chose and which frames it measured, and reads what was measured from the file
of the walk's journal; no frame is sent to it.
"""

import logging
import multiprocessing
import signal
import time
import traceback
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection

from threadpoolctl import threadpool_limits

from savmap.apps.viewer.beside import PAGE
from savmap.apps.viewer.page import View, write_view
from savmap.errors import SavmapError, SiteError, StructureError, format_error
from savmap.files.journal import Journal
from savmap.files.serialization import packed, unpacked
from savmap.jobs.cache import FolderCache
from savmap.jobs.executors import end_if_left, end_with_parent, working_folder_off_path
from savmap.jobs.map_site import MAP, made_by
from savmap.jobs.tasks import request_for
from savmap.maps.map_file import write_map
from savmap.pipeline.drive import RowWalk
from savmap.pipeline.finding import find_structures
from savmap.pipeline.records import FrameRecord, RowRequest
from savmap.pipeline.row import map_rows
from savmap.pipeline.view_plans import PassPlan
from savmap.plugin.calls import limit_hooks
from savmap.plugin.segmenters import SegmenterPool
from savmap.site.job import Job
from savmap.site.model import pass_names
from savmap.types import MapWarning, RowMap, SiteMap, Trajectory, ViewPlan
from savmap.types.maps import PROVISIONAL
from savmap.types.progress import SilentMonitor
from savmap.vision.views import Renderer

log = logging.getLogger("savmap")
MOST_MAPPED = 400
"""Frames of a provisional map; a row of twenty bays takes about half of it."""


@dataclass(frozen=True, eq=False)
class LivePlan:
    """What the walk looks at: by plugin, the views that it wants of the pass; and what speaks against the pictures."""

    views: Mapping[str, ViewPlan]
    warnings: tuple[MapWarning, ...] = ()

    @classmethod
    def of(cls, plan: PassPlan) -> "LivePlan":
        """As the plugins chose."""
        return cls(dict(plan.plans), plan.warnings)

    def planned(self, request: RowRequest) -> PassPlan:
        """The views of the row's pass."""
        (name,), (row_pass,) = pass_names(request.passes[:1]), request.passes[:1]
        return PassPlan(name, row_pass.clip, self.views, row_pass.side, self.warnings)


@dataclass(frozen=True, eq=False)
class MapRequest:
    """The times of all frames so far, the numbers of those in which something was measured, and the drive's path as
    far as it is known, as in `RowMeasurements`."""

    stamps_s: Sequence[float]
    measured: frozenset[int]
    walked: Trajectory | None = None


@dataclass(frozen=True, eq=False)
class MapReply:
    """A provisional map of the row, or why there is none yet; how many frames it is of, and how long it took.
    `is_unseen`: there is none since no structure is seen."""

    row: RowMap | None
    problem: str
    frames: int
    seconds: float
    is_unseen: bool = False


class Mapper:
    """Maps a row of a job again and again, in another process, into the job's output folder. `key`: of the frames that
    the walk's journal keeps there. `others`: maps of other rows, which are written with each of its own."""

    def __init__(self, job: Job, row: str, key: str, live_plan: LivePlan, others: Mapping[str, RowMap]) -> None:
        context = multiprocessing.get_context("spawn")
        self._line, line = context.Pipe()
        self._process = context.Process(
            target=_serve,
            args=(line, job, row, key, live_plan, packed(others)),
            name="savmap-live",
            daemon=True,
        )
        with working_folder_off_path():
            resource_tracker.ensure_running()  # beginning it would take the mask away
            waiting = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
            try:
                self._process.start()  # it inherits the mask: ctrl-C is left to this process
            finally:
                signal.pthread_sigmask(signal.SIG_SETMASK, waiting)
        line.close()
        self.is_busy = False

    def request(self, asked: MapRequest) -> None:
        """Begin a map. It must not be busy."""
        self.is_busy = True
        with suppress(OSError):
            self._line.send_bytes(packed(asked))

    def reply(self) -> MapReply | None:
        """The map that is done; None where none is yet. A process that ended is told of as a problem."""
        if not self.is_busy or not self._line.poll():
            return None
        self.is_busy = False
        try:
            return unpacked(self._line.recv_bytes(), MapReply)
        except (EOFError, OSError):
            return MapReply(None, "the process that maps has ended: out of memory, killed, or crashed", 0, 0.0)

    @property
    def is_alive(self) -> bool:
        """Whether the process still runs."""
        return self._process.is_alive()

    def close(self) -> None:
        """End the process."""
        self._process.terminate()
        self._process.join(5)
        self._line.close()


def _serve(line: Connection, job: Job, row: str, key: str, live_plan: LivePlan, others: bytes) -> None:
    end_with_parent()
    limit_hooks(job.site.plugin_timeout_s)
    journal = Journal(FolderCache(job.output).frames(row), key, is_reader=True)
    maps = ProvisionalMaps(job, row, journal, live_plan, unpacked(others, dict))
    with suppress(EOFError, OSError), threadpool_limits(1, "blas"):
        while True:
            line.send_bytes(packed(maps.map(unpacked(line.recv_bytes(), MapRequest))))


class ProvisionalMaps:
    """Maps of what a walk has measured so far of a row, one after another. `journal`: of the walk; what was measured in
    a frame is read once. `others`: maps of other rows, written with each of its own."""

    def __init__(self, job: Job, row: str, journal: Journal, live_plan: LivePlan, others: Mapping[str, RowMap]) -> None:
        self.job, self.row, self.live_plan, self.others = job, row, live_plan, others
        self._journal = journal
        self._records: dict[int, FrameRecord] = {}

    def map(self, asked: MapRequest) -> MapReply:
        """Map what the journal has, and write map.json and view.html, each whole or not at all."""
        begun, measured = time.monotonic(), len(asked.measured)
        try:
            mapped = self._mapped(asked)
            site_map = SiteMap({**self.others, mapped.name: mapped}, made_by(self.job))
            end_if_left()  # another session may go on in the folder
            write_map(site_map, self.job.output / MAP)
            write_view(View(site_map, None, f"{mapped.name} (provisional)"), self.job.output / PAGE)
        except SavmapError as error:
            unseen = isinstance(error, StructureError)
            return MapReply(None, str(error), measured, time.monotonic() - begun, unseen)
        except Exception as error:
            log.error("%s", traceback.format_exc())
            return MapReply(None, f"unexpected {format_error(error)}", measured, time.monotonic() - begun)
        return MapReply(mapped, "", measured, time.monotonic() - begun)

    def _mapped(self, asked: MapRequest) -> RowMap:
        monitor, request = SilentMonitor(), replace(request_for(self.job, self.row), appearance=False)
        plan = self.live_plan.planned(request)
        walk = RowWalk((request, plan), SegmenterPool(request.plugins), Renderer(), self._journal)
        walk.begin(plan.name, request.passes[0], monitor)
        records = self._read(asked.measured)
        for number, stamp_s in enumerate(asked.stamps_s):
            walk.take_measured(stamp_s, records.get(number))
        walked = walk.walked()
        walked = replace(walked, measurements=replace(walked.measurements, walked=asked.walked))
        measured = find_structures(walked, monitor)
        for request in (measured.request, *with_fewer_references(measured.request)):
            (result,) = map_rows([replace(measured, request=request)], monitor)
            if not isinstance(result, SiteError):  # which refers to what was not passed yet
                break
        if isinstance(result, SavmapError):
            raise result
        note = f"of {len(records)} of {len(asked.stamps_s)} frames, while the walk goes on"
        return replace(result, report={**result.report, PROVISIONAL: note})

    def _read(self, measured: frozenset[int]) -> dict[int, FrameRecord]:
        """What was measured, by frame; of a long row evenly chosen frames, so that neither time nor memory grow."""
        numbers = sorted(number for number in measured if self._journal.has(self.row, number))
        chosen = numbers[:: -(-len(numbers) // MOST_MAPPED) or 1]
        kept = {number: self._records.get(number) for number in chosen}
        read = {number: record or self._journal.get(FrameRecord, self.row, number) for number, record in kept.items()}
        self._records = {number: record for number, record in read.items() if record is not None}
        return self._records


def with_fewer_references(request: RowRequest) -> Iterator[RowRequest]:
    """The row with those of its references that may hold before all of it was passed: without lengths and points on its
    structures, then also without what plugins' settings say of these."""
    fewer = replace(request, references=replace(request.references, lengths=(), points=()))
    yield fewer
    yield replace(fewer, plugins=[plugin.before_pixels() for plugin in request.plugins])
