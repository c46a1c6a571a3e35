"""Rows on a Dask cluster (extra `cluster`): its workers do what processes beside this one would do, and give the same
bytes.

Only this process writes files. Workers read the footage, so it must be where they can read it: a shared folder, or a
URL.
"""

import re
import warnings
from collections.abc import Callable, Hashable, Iterator
from contextlib import suppress
from typing import Any

from savmap.errors import SavmapError
from savmap.jobs.cache_keys import code
from savmap.jobs.executors import Shown, WorkerCrashedError
from savmap.site.job import Job, plugins_for

ADDRESS = re.compile(r"\w+://\S+:\d+")
CONNECT_S = 15


class DaskExecutor:
    """A Dask scheduler's workers. Work whose worker dies is given to another one, up to the scheduler's
    `allowed-failures`."""

    shown: Shown | None = None

    def __init__(self, address: str, job: Job) -> None:
        """Raises SavmapError where the extra is missing, the scheduler does not answer, or a worker runs other code."""
        distributed = _library()
        if not ADDRESS.fullmatch(address):
            raise SavmapError(f"--cluster {address}: give the scheduler's address as tcp://host:8786")
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                self.client = distributed.Client(address, timeout=CONNECT_S, set_as_default=False)
        except (OSError, ValueError, TimeoutError) as error:
            raise SavmapError(
                f"--cluster {address}: no Dask scheduler answers there ({error or 'time ran out'})"
            ) from None
        self.address = address
        self.done = distributed.as_completed(loop=self.client.loop)
        self.keys: dict[str, Hashable] = {}
        self._require_same_code(job)

    @property
    def count(self) -> int:
        """Workers at the moment."""
        return len(self.client.scheduler_info(n_workers=-1)["workers"])

    def submit(self, key: Hashable, function: Callable[..., Any], *arguments: Any) -> None:
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", message="Sending large graph")
            future = self.client.submit(function, *arguments, pure=False)
        self.keys[future.key] = key
        self.done.add(future)

    def results(self) -> Iterator[tuple[Any, Any]]:
        killed = _library().scheduler.KilledWorker
        try:
            for future in self.done:
                error = future.exception()
                if isinstance(error, killed):
                    error = WorkerCrashedError(
                        "its worker ended without a word, time and again: out of memory, killed, or crashed"
                    )
                yield self.keys.pop(future.key), error or future.result()
        finally:
            with suppress(Exception):
                self.client.close()

    def _require_same_code(self, job: Job) -> None:
        """The same bytes come only from the same code. Raises SavmapError naming a worker that has another one."""
        own = code_of(job)
        for worker, theirs in self.client.run(code_of, job, on_error="return").items():
            if theirs != own:
                why = theirs if isinstance(theirs, BaseException) else "its savmap, plugins or libraries differ"
                self.client.close()
                raise SavmapError(f"--cluster {self.address}: worker {worker} would give another map: {why}")


def code_of(job: Job) -> str:
    """Fingerprint of the code that would map a job here."""
    return code(plugins_for(job, next(iter(job.site.rows))))


def _library() -> Any:
    try:
        import distributed
    except ImportError:
        raise SavmapError("--cluster needs Dask: pip install 'savmap[cluster]'") from None
    return distributed
