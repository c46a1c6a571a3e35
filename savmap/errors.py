"""Expected errors: one plain line each that says what, where and what to do, and the exit code it ends the program
with."""

import re
import sys
from collections.abc import Iterator
from contextlib import contextmanager

CONTROLS = re.compile("[\x00-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069\ufeff\ud800-\udfff]")
"""Characters that show nothing but do something to what shows them: control characters, line ends, changes of
direction, and halves of surrogate pairs, which cannot be written."""


URL = re.compile(r"\b[a-z][a-z0-9+.-]{1,30}:/[^\s\"]+", re.IGNORECASE)
"""Of one slash too, as a `Path` writes it."""
SECRETS = re.compile(
    r"(?<=:/)(/?)(?:[^/?#]*|[^/?#:]*:(?!\d+[/?#]).{,300})(?=@)"  # a password may hold what ends a host
    r"|((?:pass(?:wor|w)?d?|pwd|token|secret|sig(?:nature)?|credential|key)=)[^&;]+",
    re.IGNORECASE,
)
"""Of a URL: whose it is, with the password, and values whose names say that they are secret."""
NO_MEMORY = re.compile(
    "MemoryError|bad_alloc|insufficient memory|(cannot|unable to|failed to) (re)?allocate|failed to map segment",
    re.IGNORECASE,
)
"""In errors of Python, C++, OpenCV, the operating system and the loader of libraries."""


def without_secrets(text: str) -> str:
    """A text in whose URLs users, passwords and tokens are `***`."""
    return URL.sub(lambda url: SECRETS.sub(r"\1\2***", url[0]), text)


def visible(text: str) -> str:
    """A text on one line, in which characters that would do something to a terminal, page or table stand as escapes,
    and URLs without their secrets."""
    return CONTROLS.sub(lambda match: match[0].encode("unicode_escape").decode("ascii"), without_secrets(text))


def format_error(error: BaseException) -> str:
    """What an error of any kind is and says, in one line: "ValueError: oh"."""
    try:
        says = " ".join(str(error).split())
    except Exception:
        says = ""
    return f"{type(error).__name__}: {says}" if says else type(error).__name__


class SavmapError(Exception):
    """An error the user can mend. `exit_code` is what the command line returns for it."""

    exit_code = 1


def out_of_memory(error: BaseException) -> SavmapError | None:
    """The expected error where an error, or one that it came from, says that no memory is left; None elsewhere."""
    cause: BaseException | None = error
    while cause is not None and (isinstance(cause, SavmapError) or not NO_MEMORY.search(format_error(cause))):
        cause = cause.__cause__
    if cause is None:
        return None
    said = str(error) if isinstance(error, SavmapError) else format_error(error)
    return SavmapError(
        f"no memory is left ({said}): end other programs, take fewer workers, or raise the limit (ulimit -v)"
    )


class SiteError(SavmapError):
    """The site file or an option is wrong: unknown key, wrong unit, missing file, contradiction."""

    exit_code = 3


class VideoError(SavmapError):
    """A video cannot be used: not a video, not 2:1, empty, damaged, or a time range outside it."""

    exit_code = 4


class PluginError(SavmapError):
    """A plugin is unknown, raised, or returned something of the wrong type. The message names it."""

    exit_code = 5


class PluginFailedError(PluginError):
    """A plugin raised in a hook, or returned what the hook may not give."""

    def __init__(self, plugin: str, hook: str, what: str) -> None:
        super().__init__(plugin, hook, what)
        self.plugin, self.hook = plugin, hook
        self.what = what

    def __str__(self) -> str:
        return f"plugin `{self.plugin}` {self.what}"


class ModelError(SavmapError):
    """A network file is missing, malformed, or does not give the plugin's classes."""

    exit_code = 6


class StructureError(SavmapError):
    """The pictures do not show enough: no structure found, too few frames, too little motion, a row seen in part."""

    exit_code = 7


class SolveError(SavmapError):
    """The graph cannot be solved: scale or gauge is not observable, or references contradict one another."""

    exit_code = 8


class OutputError(SavmapError):
    """A result cannot be written, or a file to be read is not what it should be."""

    exit_code = 9


class RowsFailedError(SavmapError):
    """Some rows of a site could not be mapped; the others were."""

    exit_code = 10


class PluginsLeftOutError(SavmapError):
    """Plugins failed, and all else was mapped without them, as the site file wants it."""

    exit_code = 11


class MustCheckError(SavmapError):
    """The map was made and written, but a person should check what speaks against it."""

    exit_code = 12


class ChangedError(SavmapError):
    """Two maps of a place were compared, and something is not as it was."""

    exit_code = 13


class NothingComparedError(SavmapError):
    """Two maps were compared, and of a row, or of all, nobody can say whether it changed."""

    exit_code = 14


@contextmanager
def ending_in_one_line() -> Iterator[None]:
    """For modules that are run with `python -m`: an expected error ends the program with its line and exit code."""
    try:
        yield
    except SavmapError as error:
        print(visible(str(error)), file=sys.stderr)
        raise SystemExit(error.exit_code) from error
