"""How the command line ends: one line and a documented exit code for what is expected (docs/exit-codes.md)."""

import errno
import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from io import TextIOWrapper
from pathlib import Path
from typing import NoReturn

from savmap.cli.speech import say
from savmap.errors import OutputError, SavmapError, SiteError, out_of_memory

EPOCH = "SOURCE_DATE_EPOCH"
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
        _settle_terminal()
        _settle_environment()
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
        _no_room(error)
    except SystemExit as end:
        if end.code == INTERRUPTED:
            _interrupted()
        raise


def _settle_terminal() -> None:
    """Let characters that the terminal's encoding lacks stand as escapes on standard output too, as they do on standard
    error."""
    if isinstance(sys.stdout, TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")


def _settle_environment() -> None:
    """Take an empty SOURCE_DATE_EPOCH for one that is not set, and let libraries find nothing where a user has no home:
    they would end with errors of their own. Raises SiteError for a SOURCE_DATE_EPOCH that is no number."""
    try:
        Path.home()
    except RuntimeError:
        os.environ["HOME"] = os.devnull
    epoch = os.environ.get(EPOCH)
    if epoch is not None and not epoch.strip():
        del os.environ[EPOCH]
    elif epoch is not None and not (epoch.isascii() and epoch.isdecimal()):
        raise SiteError(f"{EPOCH}={epoch}: a whole number of seconds since 1970 is expected; correct it or unset it")


def _no_room(error: OSError) -> NoReturn:
    """A full disk that nothing has told in its own words yet, such as that of the standard output."""
    where = error.filename or "standard output"
    reason = (error.strerror or str(error)).lower()
    with suppress(OSError):
        say(f"savmap: {where}: cannot be written ({reason}); choose another folder or free its space", err=True)
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    sys.exit(OutputError.exit_code)


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
