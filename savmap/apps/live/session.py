"""A live session: frames come in, the latest are measured as fast as this machine can, what was measured is mapped
again and again, and whoever walks is told what to do.

Nothing that comes in is lost: the footage is on disk, or is written there, and `finish` maps all of it as `savmap map`
does. Until then maps are provisional: of the frames for which there was time.
"""

import json
import logging
import os
import shutil
import threading
import time
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from types import MappingProxyType

import numpy as np

from savmap.apps.live.assistant import (
    DISK_BYTES,
    LAG_S,
    Advice,
    CaptureAssistant,
    advice_of_map,
    most_urgent,
)
from savmap.apps.live.mapper import LivePlan, Mapper, MapReply, MapRequest
from savmap.errors import OutputError, SavmapError, StructureError, format_error
from savmap.files.atomic import write_text
from savmap.files.journal import Journal, forget
from savmap.files.urls import is_url
from savmap.geometry.vanishing import RIG_UP
from savmap.jobs.cache import FolderCache
from savmap.jobs.cache_keys import digest
from savmap.jobs.map_site import MAP, MAPPED
from savmap.jobs.tasks import request_for
from savmap.maps.map_file import read_map
from savmap.pipeline.drive import RowWalk, Way, before_face
from savmap.pipeline.records import RowRequest
from savmap.pipeline.view_plans import plan_shown
from savmap.plugin.segmenters import SegmenterPool
from savmap.site.job import Job, prepare
from savmap.site.model import pass_names
from savmap.site.preflight import tells_scale
from savmap.types import Panorama, RowMap, View, ViewSpec
from savmap.types.progress import SilentMonitor
from savmap.vision.odometry import Follower
from savmap.vision.view_planning import PassPreview
from savmap.vision.views import Renderer

log = logging.getLogger("savmap")
STATE = "live.json"
PLAN = "live, plan"
WORKERS = min(2, os.cpu_count() or 1)
"""Frames that are rendered and segmented at a time."""
PREVIEWED, KEYS, PAIRS = 16, 5, 3
"""Frames from which views are chosen, at the least; of these so many are asked, and so many pairs of neighbours."""
MOST_PREVIEWED = 48
FIRST_MAP, FURTHER = 6, 3
"""Measured frames before the first map, and between two maps."""
SURE_UNSEEN = 2 * FIRST_MAP
"""Measured frames in which no structure is seen together, before that is said."""
STATE_S = 0.5


@dataclass(frozen=True, eq=False)
class LiveState:
    """How far a session is, as `live.json` holds it: seconds of footage; frames that came, that were measured, and that
    were passed over until the end; what to do, the most urgent first; elements of the latest map, how many of its
    frames it is of, how long it took and its problem, if there was none.

    `status`: "walking", "stopped", "mapping" (all that was recorded), and then "mapped", where the problem is which
    rows must be checked, or "failed"."""

    status: str
    footage_s: float = 0.0
    frames: int = 0
    measured: int = 0
    passed_over: int = 0
    lag_s: float = 0.0
    advice: Sequence[Advice] = ()
    maps: int = 0
    elements: int = 0
    mapped_frames: int = 0
    map_s: float = 0.0
    problem: str = ""

    def as_json(self) -> str:
        """The state's text."""
        return json.dumps(asdict(self), indent=1) + "\n"


@contextmanager
def end_told(output: Path) -> Iterator[None]:
    """Let `live.json` in an output folder tell that all that was recorded is mapped, which is done meanwhile, and how
    it ends."""
    path = output / STATE
    failure: BaseException | None = None
    state = asdict(LiveState("mapping")) | (json.loads(path.read_text(encoding="utf-8")) if path.is_file() else {})
    state |= {"status": "mapping", "lag_s": 0.0, "advice": [], "problem": ""}
    write_text(path, json.dumps(state, indent=1) + "\n")
    try:
        yield
    except BaseException as error:
        failure = error
        raise
    finally:
        if failure is None or isinstance(failure, MAPPED):
            site_map = read_map(output / MAP)
            elements = sum(len(group) for row in site_map.rows.values() for group in row.structures.values())
            state |= {"status": "mapped", "elements": elements, "problem": site_map.banner}
        else:
            state |= {"status": "failed", "problem": str(failure) or "it was interrupted"}
        write_text(path, json.dumps(state, indent=1) + "\n")


class _LatestFrames:
    """The latest frame, which waits to be measured; `passed_over` counts those for which there was no time. The first
    frames are all kept, until views are chosen by them."""

    def __init__(self) -> None:
        self.passed_over = 0
        self._waiting: deque[Panorama] = deque()
        self._changed = threading.Condition()
        self._are_first, self._is_closed = True, False

    def put(self, panorama: Panorama) -> None:
        with self._changed:
            self._waiting.append(panorama)
            if len(self._waiting) > (MOST_PREVIEWED if self._are_first else 1):
                self.drop(1)
            self._changed.notify_all()

    def first(self, count: int) -> list[Panorama] | None:
        """The first frames, once there are so many; None once it is closed."""
        with self._changed:
            self._changed.wait_for(lambda: len(self._waiting) >= count or self._is_closed)
            return None if self._is_closed else list(self._waiting)

    def latest(self) -> Panorama | None:
        """The latest frame, when there is one that was not taken yet; None once it is closed."""
        with self._changed:
            self._are_first = False
            self._changed.wait_for(lambda: bool(self._waiting) or self._is_closed)
            if self._is_closed:
                return None
            self.drop(len(self._waiting) - 1)
            return self._waiting.popleft()

    def drop(self, count: int) -> None:
        """Pass over the oldest ones."""
        with self._changed:
            for _ in range(count):
                self._waiting.popleft()
                self.passed_over += 1

    def close(self) -> None:
        with self._changed:
            self._is_closed = True
            self._changed.notify_all()


class _EndingRenderer(Renderer):
    """Renders until it is closed: whatever waits for further views then ends at once."""

    def __init__(self) -> None:
        super().__init__()
        self.is_closed = False

    def render(self, panorama: Panorama, spec: ViewSpec) -> View:
        """A view. Raises SavmapError once it is closed."""
        if self.is_closed:
            raise SavmapError("the session has ended")
        return super().render(panorama, spec)


class LiveMapping:
    """One row that is mapped while it is filmed. `job`: with the row's footage, which may not be there yet; `output`
    is where maps and the state are written. `resume`: go on with what an earlier session measured there. `others`: maps
    of rows that were filmed before, which stay in the maps that are written.

    `take` gets the footage's frames in order, numbered from 0. Raises SiteError, PluginError and ModelError for what is
    wrong with the job, and OutputError where nothing can be written.
    """

    def __init__(
        self, job: Job, row: str, resume: bool = False, others: Mapping[str, RowMap] = MappingProxyType({})
    ) -> None:
        if is_url(job.output):
            raise OutputError(f"{job.output}: a live session writes all the time: give a folder of this machine")
        prepare(job.output)
        self.job, self.row, self._others = job, row, others
        self.request: RowRequest = request_for(job, row)
        self._tells_scale = job.against is not None or tells_scale(job.site, row, job.plugins)
        self.assistant = CaptureAssistant()
        self.latest: RowMap | None = None
        self._key = digest(live=job.site.model_dump(mode="json"), row=row)
        self._kept_in = FolderCache(job.output).frames(row)
        if not resume:
            self.forget()
        self._journal = Journal(self._kept_in, self._key)
        self._renderer, self._frames = _EndingRenderer(), _LatestFrames()
        self._follower, self._way, self._fronts = Follower(), Way(), list[float]()
        self._stamps: list[float] = []
        self._to_measure: list[float] = []
        self._measured: set[int] = set()
        self._advice: list[Advice] = []
        self._walk: RowWalk | None = None
        self._mapper: Mapper | None = None
        self._hooks = threading.Lock()
        self._failure: SavmapError | None = None
        self._reply = MapReply(None, "", 0, 0.0)
        self._maps, self._stated_s, self._looked_for, self._handled = 0, 0.0, PREVIEWED, 0.0
        if resume:
            live_plan = self._journal.get(LivePlan, PLAN, 0)
            if live_plan is not None:
                self._begin(live_plan)
        self._worker = threading.Thread(target=self._work, name="savmap-walk", daemon=True)
        self._worker.start()

    @property
    def resumed(self) -> int:
        """How many frames an earlier session measured."""
        return self._journal.earlier[self.row]

    @property
    def maps(self) -> Mapping[str, RowMap]:
        """The latest provisional map of the row, once there is one, and those of rows that were filmed before."""
        return self._others if self.latest is None else {**self._others, self.latest.name: self.latest}

    @property
    def measured(self) -> frozenset[int]:
        """The numbers of the frames in which something was measured."""
        return frozenset(self._measured)

    def take(self, panorama: Panorama, measures: bool = True) -> LiveState:
        """Take the next frame, in which nothing is measured if there is no row to be seen in it, or the camera hardly
        moved on. Raises the error by which measuring failed."""
        if self._failure is not None:
            raise self._failure
        self._stamps.append(panorama.stamp_s)
        advice = self.assistant.take(panorama)
        followed = self._follower.update(panorama)
        is_key = self._way.take(followed) or self._walk is None
        self._follower.forget(self._way.unfit)
        self._fronts.append(self._way.front(self._walk.towards if self._walk is not None else None))
        if self._journal.has(self.row, panorama.frame):
            self._measured.add(panorama.frame)
        elif measures and is_key:
            self._to_measure.append(panorama.stamp_s)
            self._frames.put(panorama)
        self._map_again()
        self._advice = [*advice, *self._further_advice()]
        state = self.state("walking")
        if time.monotonic() - self._stated_s > STATE_S:
            write_text(self.job.output / STATE, state.as_json())
            self._stated_s = time.monotonic()
        return state

    def state(self, status: str) -> LiveState:
        """How far the session is."""
        structures = self.latest.structures.values() if self.latest is not None else ()
        return LiveState(
            status,
            footage_s=round(self._stamps[-1] - self._stamps[0], 3) if self._stamps else 0.0,
            frames=len(self._stamps),
            measured=len(self._measured),
            passed_over=self._frames.passed_over,
            lag_s=round(self._lag_s(), 3),
            advice=tuple(sorted(self._advice, key=lambda item: item is not most_urgent(self._advice))),
            maps=self._maps,
            elements=sum(map(len, structures)),
            mapped_frames=self._reply.frames,
            map_s=round(self._reply.seconds, 2),
            problem=self._reply.problem,
        )

    def stop(self) -> None:
        """End measuring and mapping; what was measured is kept."""
        self._renderer.is_closed = True
        self._frames.close()
        self._worker.join()
        self._journal.flush()
        if self._mapper is not None:
            self._mapper.close()
        write_text(self.job.output / STATE, self.state("stopped").as_json())

    def forget(self) -> None:
        """Let what was measured be forgotten, once the session has ended."""
        if self._kept_in is not None:
            forget(self._kept_in)

    def __enter__(self) -> "LiveMapping":
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    def _plan(self) -> bool:
        """Wait for the first frames, and choose the views by them; whether the session goes on."""
        while self._walk is None:
            if (first := self._frames.first(self._looked_for)) is None:
                return False
            keys = [first[number] for number in np.linspace(0, len(first) - 1, KEYS).astype(int)]
            begins = np.linspace(0, len(first) - 2, PAIRS).astype(int)
            pairs = [(first[number], first[number + 1]) for number in begins]
            name, row_pass = pass_names(self.request.passes)[0], self.request.passes[0]
            try:
                preview = PassPreview.of_frames(keys, pairs, self._renderer)
                attitude = self.request.attitudes.get(name)
                plan = plan_shown(name, row_pass, self.request.plugins, preview, attitude)
            except StructureError as error:
                self._reply = MapReply(None, str(error), 0, 0.0, is_unseen=True)
                self._looked_for = min(self._looked_for + PREVIEWED, MOST_PREVIEWED)
                self._frames.drop(PREVIEWED if len(first) >= MOST_PREVIEWED else 0)
            else:
                self._begin(LivePlan.of(plan))
        return True

    def _begin(self, live_plan: LivePlan) -> None:
        """Begin to measure and to map."""
        self._reply = MapReply(None, "", 0, 0.0)
        if not self._journal.has(PLAN, 0):
            self._journal.add(PLAN, 0, live_plan)
        plan = live_plan.planned(self.request)
        self._walk = RowWalk((self.request, plan), SegmenterPool(self.request.plugins), self._renderer, self._journal)
        self._walk.begin(plan.name, self.request.passes[0], SilentMonitor())
        self._way.keys.towards = [] if self._walk.towards is None else [self._walk.towards]
        attitude = plan.attitude()
        if attitude is not None:
            towards = attitude.T @ np.array([0.0, 0.0, -1.0])
            self.assistant.facing_deg = float(np.degrees(np.arctan2(towards[0], towards[2])))
            up = attitude.T @ np.array([0.0, 1.0, 0.0])
            self.assistant.tilt_deg = float(np.degrees(np.arccos(np.clip(RIG_UP @ up, -1, 1))))
        self._mapper = Mapper(self.job, self.row, self._key, live_plan, self._others)

    def _work(self) -> None:
        """Choose the views, then measure the latest frames, several at a time where this machine has the cores;
        plugins' hooks are called one at a time."""
        try:
            if self._plan():
                with ThreadPoolExecutor(WORKERS, "savmap-live") as pool:
                    for done in [pool.submit(self._measure) for _ in range(WORKERS)]:
                        done.result()
        except SavmapError as error:
            self._failure = None if self._renderer.is_closed else error
        except Exception as error:
            log.exception("a live session's walk")
            self._failure = SavmapError(f"unexpected {format_error(error)}; please report it with savmap.log")

    def _measure(self) -> None:
        walk = self._walk
        while walk is not None and self._failure is None and (panorama := self._frames.latest()) is not None:
            rendered = walk.render(panorama, {})
            with self._hooks:
                walk.measure_ahead(panorama, rendered)
            self._measured.add(panorama.frame)
            self._handled = max(self._handled, panorama.stamp_s)

    def _map_again(self) -> None:
        """Take a map that is done, and ask for another where enough was measured since."""
        mapper = self._mapper
        if mapper is None:
            return
        if (reply := mapper.reply()) is not None:
            self._reply = reply
            if reply.row is not None:
                self.latest, self._maps = reply.row, self._maps + 1
        new = len(self._measured) - self._reply.frames
        if not mapper.is_busy and mapper.is_alive and new >= (FURTHER if self._maps else FIRST_MAP):
            self._journal.flush()
            walked = before_face(self._way.odometry.path, np.arange(len(self._stamps)), self._fronts)
            mapper.request(MapRequest(tuple(self._stamps), self.measured, walked))

    def _lag_s(self) -> float:
        """By how much footage what was measured is behind what came to be; first, behind the frames by which views are
        chosen."""
        came = self._to_measure
        return max(came[-1] - max(self._handled, came[:PREVIEWED][-1]), 0.0) if came else 0.0

    def _further_advice(self) -> list[Advice]:
        advice = []
        if not self._tells_scale:
            text = "The scale is not known: measure the camera's height above the floor, and give --camera-height."
            advice.append(Advice("no-scale", "attention", text))
        is_sure = self._walk is None or self._reply.frames >= SURE_UNSEEN
        if self._reply.is_unseen and is_sure and not self._maps:
            text = f"Nothing is seen that can be mapped: {self._reply.problem}."
            if self.job.against is not None and self._walk is not None:
                text = f"Not recognised in the earlier map: {self._reply.problem}."
            advice.append(Advice("not-seen", "attention", text))
        if self.latest is not None and len(self.latest.trajectory.frames):
            advice += advice_of_map(self.latest, self.latest.trajectory.world_from_rig[-1, :3, 3])
        if self._lag_s() > LAG_S:
            text = "The map comes behind; nothing of the recording is lost, walk on."
            advice.append(Advice("lag", "good", text))
        if shutil.disk_usage(self.job.output).free < DISK_BYTES:
            advice.append(Advice("disk", "stop", f"{self.job.output}: the disk is nearly full; make room."))
        return advice
