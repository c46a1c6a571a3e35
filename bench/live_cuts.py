"""What is left where `savmap live` is cut off: killed, its disk full, or its source lost, at random
moments of a walk and of the final map."""

import json
import random
import resource
import shutil
import signal
import socket
import struct
import subprocess
import sys
import threading
import time
from collections import Counter
from contextlib import suppress
from io import BytesIO
from pathlib import Path

import av
import cv2

from bench.baseline import Figures
from savmap.apps.live.session import STATE
from savmap.errors import SavmapError
from savmap.files.atomic import sha256
from savmap.maps.map_file import read_map

DEMO = Path(__file__).parents[1] / "savmap" / "demo" / "aisle-dev.mp4"
NETWORK = Path(__file__).parents[1] / "plugins" / "shelves" / "savmap_shelves" / "model" / "shelves.int8.onnx"
BEGIN_S, END_S = 3.0, 9.0
SITE = f"""\
plugins: {{shelves: {{model: {NETWORK}, every: 2}}}}
references: {{camera_height_m: {{value: 3.055, sigma: 0.02}}}}
orthophotos: false
panoramas: false
rows:
  A:
    passes:
      - video: {DEMO}
        side: left
        start_s: {BEGIN_S}
        end_s: {END_S}
        views: {{face: {{yaw_deg: -79.4, pitch_deg: 1.9, roll_deg: 0.1, hfov_deg: 148.5}}}}
"""
"""Six seconds of the demo, the network and the views of which are given, so that a walk takes seconds."""
KINDS = ("killed", "killed", "disk full", "killed", "source lost")
TO_THE_END = 10
"""After so many interruptions a session is left to go on to its end."""
ENDS_S = 600.0
MAPPED = 0, 12
"""Exit codes of `savmap map` where there is a map: to be trusted, or to be checked."""
Interrupted = subprocess.Popen[bytes]


def cuts(count: int, pace: float, folder: Path) -> Figures:
    """Interrupt sessions, each of which goes on where the last one stood; print and return totals."""
    walks = Walks(folder, pace)
    for number in range(count):
        kind = KINDS[number % len(KINDS)]
        walks.lose_source(number) if kind == "source lost" else walks.cut(kind)
        if number % TO_THE_END == TO_THE_END - 1:
            walks.to_the_end()
        print(dict(sorted(walks.totals.items())), flush=True)
    return {"cuts": dict(sorted(walks.totals.items()))}


class Walks:
    """Sessions in a folder. `totals`: interruptions by kind and by how far the session was, what was broken after
    them, and whether the map at the end has the bytes of that of `savmap map`."""

    def __init__(self, folder: Path, pace: float) -> None:
        self.folder, self.pace, self.totals = folder, pace, Counter[str]()
        self._chance, self._number = random.Random(1), 0
        folder.mkdir(parents=True, exist_ok=True)
        self.site = folder / "site.yaml"
        self.site.write_text(SITE, encoding="utf-8")
        run_savmap("map", self.site, "-o", folder / "batch")
        self.batch = sha256(folder / "batch" / "map.json")
        begun = time.monotonic()
        self.to_the_end()
        self._length_s = time.monotonic() - begun

    @property
    def output(self) -> Path:
        """The folder of the walk that goes on."""
        return self.folder / f"walk-{self._number}"

    def cut(self, kind: str) -> None:
        """Interrupt the walk at a random moment."""
        (self.output / STATE).unlink(missing_ok=True)
        session = self._session()
        with suppress(subprocess.TimeoutExpired):
            session.wait(self._chance.uniform(2.0, self._length_s))
        if session.poll() is not None:
            self.totals["ended before"] += 1
            self._end(session.wait())
            return
        self.totals[f"{kind}, {phase(self.output)}"] += 1
        if kind == "killed":
            session.send_signal(signal.SIGKILL)
        else:
            fill_disk(session.pid)
        code = session.wait(ENDS_S)
        self.totals[f"{kind}, exit code {code}"] += 1
        self._count_faults(self.output)

    def lose_source(self, number: int) -> None:
        """Film from an address that ends at a random moment; what was recorded must be mapped as `savmap map` does."""
        output, content = self.folder / f"camera-{number}", stream_of(DEMO)
        sent = self._chance.uniform(0.1, 1.0)
        with Sender(content[: round(sent * len(content))], (END_S - BEGIN_S) * sent / self.pace) as sender:
            code = run_savmap("live", self.site, "--camera", sender.address, "-o", output)
        self.totals[f"source lost, exit code {code}"] += 1
        self._count_faults(output)
        if code in MAPPED:
            site, batch = self.folder / f"camera-{number}.yaml", self.folder / f"camera-{number}-batch"
            lines = [line for line in SITE.splitlines() if "start_s" not in line and "end_s" not in line]
            site.write_text("\n".join(lines).replace(str(DEMO), str(output / "recording.mkv")), encoding="utf-8")
            self.totals["OTHER EXIT CODE of the batch"] += run_savmap("map", site, "-o", batch) != code
            self._compare(output, sha256(batch / "map.json") if (batch / "map.json").is_file() else "")
        shutil.rmtree(output, ignore_errors=True)

    def to_the_end(self) -> None:
        """Let the walk go on to its end."""
        self._end(self._session().wait(ENDS_S))

    def _session(self) -> Interrupted:
        return begun("live", self.site, "--resume", "--pace", self.pace, "-o", self.output)

    def _end(self, code: int) -> None:
        self.totals[f"to the end, exit code {code}"] += 1
        self._count_faults(self.output)
        self._compare(self.output, self.batch)
        shutil.rmtree(self.output, ignore_errors=True)
        self._number += 1

    def _compare(self, output: Path, expected: str) -> None:
        same = (output / "map.json").is_file() and sha256(output / "map.json") == expected
        self.totals["same bytes at the end" if same else "OTHER BYTES at the end"] += 1
        if not same:
            shutil.copytree(output, self.folder / f"other-{output.name}", dirs_exist_ok=True)

    def _count_faults(self, output: Path) -> None:
        self.totals["a map is there" if (output / "map.json").is_file() else "no map yet"] += 1
        for path in sorted(output.rglob("*")):
            if path.is_file() and not is_whole(path):
                self.totals[f"BROKEN {path.name}"] += 1


def begun(*arguments: object) -> Interrupted:
    """A command that was begun, without its output."""
    command = [sys.executable, "-m", "savmap", *map(str, arguments)]
    return subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def run_savmap(*arguments: object) -> int:
    """A command's exit code."""
    return begun(*arguments).wait(ENDS_S)


def phase(output: Path) -> str:
    """How far a session is."""
    try:
        state = json.loads((output / STATE).read_text(encoding="utf-8"))
    except OSError:
        return "before the first frame"
    if state["status"] != "walking":
        return "during the final map"
    return "mapped" if state["maps"] else "measuring" if state["measured"] else "walking"


def fill_disk(pid: int) -> None:
    """Let a process and those that it began write no file any more (Linux)."""
    for part in [pid, *descendants(pid)]:
        with suppress(ProcessLookupError):
            resource.prlimit(part, resource.RLIMIT_FSIZE, (0, resource.RLIM_INFINITY))


def descendants(pid: int) -> list[int]:
    """The processes that a process began, and those that these did."""
    children: list[int] = []
    for task in Path(f"/proc/{pid}/task").glob("*"):
        with suppress(OSError):
            children += map(int, (task / "children").read_text(encoding="utf-8").split())
    return [*children, *(pid for child in children for pid in descendants(child))]


def is_whole(path: Path) -> bool:
    """Whether a file is what its name says, from its beginning to its end; only logs may end anywhere."""
    try:
        if path.name == "map.json":
            return bool(read_map(path).rows)
        if path.suffix == ".json":
            return json.loads(path.read_text(encoding="utf-8")) is not None
        if path.suffix == ".html":
            return path.read_text(encoding="utf-8").rstrip().endswith("</html>")
        if path.suffix in (".png", ".jpg"):
            return cv2.imread(str(path)) is not None
        return True
    except (ValueError, SavmapError):
        return False


def stream_of(video: Path) -> bytes:
    """The packets of the clip's seconds, as a stream (MPEG-TS)."""
    stream = BytesIO()
    with av.open(str(video)) as source, av.open(stream, "w", "mpegts") as target:
        given = source.streams.video[0]
        copied = target.add_stream_from_template(given)
        tick_s = float(given.time_base or 1)
        source.seek(round(BEGIN_S / tick_s), stream=given)
        for packet in source.demux(given):
            if packet.dts is not None and packet.dts * tick_s < END_S:
                packet.stream = copied
                target.mux(packet)
    return stream.getvalue()


class Sender:
    """Sends a stream to the first who asks, in so many seconds, then breaks the connection off."""

    def __init__(self, content: bytes, seconds: float) -> None:
        self._server = socket.create_server(("127.0.0.1", 0))
        self.address = f"tcp://127.0.0.1:{self._server.getsockname()[1]}"
        self._thread = threading.Thread(target=self._send, args=(content, seconds), daemon=True)

    def _send(self, content: bytes, seconds: float) -> None:
        connection, _ = self._server.accept()
        with connection, suppress(OSError):
            step = max(len(content) // max(round(10 * seconds), 1), 1)
            for begin in range(0, len(content), step):
                connection.sendall(content[begin : begin + step])
                time.sleep(0.1)
            connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))

    def __enter__(self) -> "Sender":
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._server.close()
        self._thread.join(5)
