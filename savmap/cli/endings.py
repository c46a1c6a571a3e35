"""How the command line ends: one line and a documented exit code for what is expected (docs/exit-codes.md)."""

import errno
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import NoReturn

from savmap.cli.speech import say
from savmap.errors import OutputError, SavmapError, SiteError

INTERRUPTED = 130
NO_NAMES = {errno.ENAMETOOLONG, errno.ELOOP}
"""What only the name of a file can have done that somebody gave."""
NO_ROOM = {errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS}


@contextmanager
def plain_endings() -> Iterator[None]:
    """End the program with one line where what is done in it ends with an expected error; all others keep their traceback."""
    try:
        yield
    except SavmapError as error:
        say(f"savmap: {error}", err=True)
        sys.exit(error.exit_code)
    except KeyboardInterrupt:
        _interrupted()
    except OSError as error:
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


def _no_room(error: OSError) -> NoReturn:
    """A full disk that nothing has told in its own words yet, such as that of the standard output."""
    where = error.filename or "standard output"
    reason = (error.strerror or str(error)).lower()
    with suppress(OSError):
        say(f"savmap: {where}: cannot be written ({reason}); choose another folder or free its space", err=True)
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    sys.exit(OutputError.exit_code)


def _interrupted() -> NoReturn:
    say("savmap: interrupted", err=True)
    sys.exit(INTERRUPTED)
