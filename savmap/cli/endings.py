"""How the command line ends: one line and a documented exit code for what is expected (docs/exit-codes.md)."""

import errno
import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import NoReturn

from savmap.cli.speech import say
from savmap.errors import OutputError, SavmapError, SiteError, out_of_memory

INTERRUPTED, TERMINATED = 130, 143
NO_NAMES = {errno.ENAMETOOLONG, errno.ELOOP}
"""What only the name of a file can have done that somebody gave."""
NO_ROOM = {errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS}


_terminated = threading.Event()


@contextmanager
def plain_endings() -> Iterator[None]:
    """End the program with one line where what is done in it ends with an expected error; all others keep their
    traceback."""
    try:
        with _terminated_as_interrupted():
            yield
    except KeyboardInterrupt:
        _interrupted()
    except Exception as error:
        expected = out_of_memory(error) or error
        if isinstance(expected, SavmapError):
            say(f"savmap: {expected}", err=True)
            sys.exit(expected.exit_code)
        if not isinstance(error, OSError):
            raise
        if error.errno in NO_NAMES:
            say(f"savmap: {str(error.filename)[:200]}: {(error.strerror or str(error)).lower()}", err=True)
            sys.exit(SiteError.exit_code)
        if error.errno not in NO_ROOM:
            raise
        # a full disk that nothing has told in its own words yet, such as that of the standard output
        place, why = error.filename or "standard output", (error.strerror or str(error)).lower()
        with suppress(OSError):
            say(f"savmap: {place}: cannot be written ({why}); choose another folder or free its space", err=True)
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        sys.exit(OutputError.exit_code)
    except SystemExit as end:
        if end.code == INTERRUPTED:
            _interrupted()
        raise


@contextmanager
def _terminated_as_interrupted() -> Iterator[None]:
    """While this lasts, let a SIGTERM end what is done as ctrl-C does, so that nothing half done is left; a second one
    ends the program at once."""
    _terminated.clear()
    if (
        signal.getsignal(signal.SIGTERM) is not signal.SIG_DFL
        or threading.current_thread() is not threading.main_thread()
    ):
        yield
        return

    def end(number: int, _: object) -> NoReturn:
        signal.signal(number, signal.SIG_DFL)
        _terminated.set()
        raise KeyboardInterrupt

    signal.signal(signal.SIGTERM, end)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, signal.SIG_DFL)


def _interrupted() -> NoReturn:
    terminated = _terminated.is_set()
    say(f"savmap: {'terminated' if terminated else 'interrupted'}", err=True)
    sys.exit(TERMINATED if terminated else INTERRUPTED)
