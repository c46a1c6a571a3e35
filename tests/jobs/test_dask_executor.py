"""Rows on a real Dask scheduler with two real workers, one of which is killed in mid-run: the same bytes as here, where
all use the same BLAS kernels, and nearly the same maps where they do not."""

import os
import platform
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import distributed
import numpy as np
import pytest

from savmap.errors import MustCheckError, SavmapError
from savmap.files.atomic import write_text
from savmap.files.serialization import unpacked
from savmap.jobs.cache import FolderCache
from savmap.jobs.executors import Cluster
from savmap.jobs.scheduler import RunOptions, map_rows_of
from savmap.site.job import job_for
from savmap.types import RowMap
from savmap.types.progress import SilentMonitor

from ..integration.sealed import surroundings

EXAMPLE = Path(__file__).parents[2] / "examples" / "aisle-dev"
pytestmark = [pytest.mark.slow, pytest.mark.filterwarnings("ignore")]


def dask(home: Path, *arguments: str) -> "subprocess.Popen[bytes]":
    kinds = {"scheduler": "dask_scheduler", "worker": "dask_worker"}
    command = [sys.executable, "-W", "ignore", "-m", f"distributed.cli.{kinds[arguments[0]]}", *arguments[1:]]
    return subprocess.Popen(command, env=surroundings(home), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


@pytest.fixture(scope="module")
def cluster(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[str, list["subprocess.Popen[bytes]"]]]:
    """A scheduler's address, and its two workers' processes, which write nothing at home."""
    folder, home = tmp_path_factory.mktemp("dask"), tmp_path_factory.mktemp("home")
    info = folder / "scheduler.json"
    scheduler = dask(home, "scheduler", "--port", "0", "--no-dashboard", "--scheduler-file", str(info))
    where = ("--scheduler-file", str(info), "--local-directory", str(folder))
    workers = [dask(home, "worker", "--no-nanny", "--no-dashboard", "--nthreads", "1", *where) for _ in range(2)]
    with distributed.Client(scheduler_file=str(info), timeout=600, set_as_default=False) as client:
        client.wait_for_workers(2, timeout=600)
        address = client.scheduler.address
    yield address, workers
    for process in (*workers, scheduler):
        process.kill()
        process.wait()
    assert not list(home.rglob("*"))


def site(folder: Path, **rates: float) -> Path:
    """Rows that share no frames: the first half of the same face at different rates."""
    text = "plugins: {shelves: {}}\nreferences: {camera_height_m: {value: 3.055}}\nrows:\n"
    video = EXAMPLE / "aisle-dev.mp4"
    for name, fps in (rates or {"A": 1.0, "B": 1.2}).items():
        text += f"  {name}: {{passes: [{{video: {video}, side: left, end_s: 9, fps: {fps}}}]}}\n"
    write_text(folder / "site.yaml", text)
    return folder / "site.yaml"


def test_a_worker_killed_in_mid_run_changes_nothing(
    cluster: tuple[str, list["subprocess.Popen[bytes]"]], tmp_path: Path
) -> None:
    address, workers = cluster
    path = site(tmp_path)
    here = map_rows_of(
        job_for(path, None, tmp_path / "here"), RunOptions(jobs=0), SilentMonitor(), FolderCache(tmp_path / "here")
    )
    killer = Killer(workers[0])
    there = map_rows_of(
        job_for(path, None, tmp_path / "there"), RunOptions(cluster=address), killer, FolderCache(tmp_path / "there")
    )
    assert workers[0].wait(10) != 0
    assert killer.after == 1
    assert not there.failed
    assert there.log.jobs == 2
    for name in here.rows:
        kept = [tmp_path / place / "stages" / name / "solved" for place in ("here", "there")]
        assert kept[0].read_bytes() == kept[1].read_bytes()


class Killer(SilentMonitor):
    """A Monitor that kills a worker when the first piece of work is done, while others are under way."""

    def __init__(self, victim: "subprocess.Popen[bytes]") -> None:
        self.victim, self.after = victim, 0

    def each(self, items, doing, total=None):  # type: ignore[no-untyped-def]
        for number, item in enumerate(items):
            if number == 0:
                self.victim.kill()
                self.after = number + 1
            yield item


KERNELS = {"x86_64": ("Nehalem", "Haswell"), "aarch64": ("ARMV8", "NEOVERSEN1")}
"""Of OpenBLAS, by machine: without and with AVX2, and the plainest beside that of a server."""
MAPS = """
import scipy.linalg
from threadpoolctl import threadpool_info
print({library["architecture"] for library in threadpool_info() if "scipy_openblas" in library["prefix"]})
from savmap.cli.app import main
main()
"""


@pytest.mark.skipif(platform.machine() not in KERNELS, reason="no other kernels to choose")
def test_other_blas_kernels_move_no_vertex_by_a_third_of_its_sigma(tmp_path: Path) -> None:
    """Hardly at all, but where a decision stands on a tie: here whether a twelfth or a thirteenth place tells how deep beams lie."""
    path, used, rows = site(tmp_path, A=1.0), [], []
    for kernel in KERNELS[platform.machine()]:
        options = (
            "--plugins",
            "shelves",
            "--jobs",
            "0",
            "--no-panoramas",
            "--no-orthophotos",
            "-o",
            str(tmp_path / kernel),
        )
        command = [sys.executable, "-c", MAPS, "map", str(path), *options]
        environment = os.environ | {"OPENBLAS_CORETYPE": kernel}
        done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=1800, check=False)
        assert done.returncode in (0, MustCheckError.exit_code), done.stdout + done.stderr
        used.append(done.stdout.splitlines()[0])
        rows.append(unpacked(FolderCache(tmp_path / kernel).load("A", "solved", None) or b"", RowMap))
    if used[0] == used[1]:
        pytest.skip(f"NumPy chooses no kernels: {used[0]}")
    pairs = [*zip(*(row.structures["shelves"] for row in rows), strict=True)]
    assert [one.id for one, _ in pairs] == [other.id for _, other in pairs]
    for one, other in pairs:
        sigmas = np.sqrt(np.diagonal(one.covariances, axis1=1, axis2=2))
        assert (np.abs(other.vertices - one.vertices) <= sigmas / 3).all(), one.id
        assert np.sqrt(np.diagonal(other.covariances, axis1=1, axis2=2)) == pytest.approx(sigmas, rel=0.1)


def test_no_scheduler_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("savmap.jobs.executors.CONNECT_S", 0.5)
    with pytest.raises(SavmapError, match="no Dask scheduler answers there"):
        Cluster("tcp://127.0.0.1:9", job_for(site(tmp_path), None, tmp_path))


def test_a_worker_with_other_code_is_named(
    cluster: tuple[str, list["subprocess.Popen[bytes]"]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("savmap.jobs.executors.code", lambda _: "another")
    with pytest.raises(
        SavmapError, match=r"worker tcp://.* would give another map: its savmap, plugins or libraries differ"
    ):
        Cluster(cluster[0], job_for(site(tmp_path), None, tmp_path))
