"""What the command line prints: text of any origin, of which no character but a line's end does anything to the
terminal."""

import sys

from savmap.errors import visible


def say(line: object, err: bool = False) -> None:
    """Print one line."""
    print(visible(str(line)), file=sys.stderr if err else sys.stdout, flush=True)


def say_all(text: str) -> None:
    """Print several lines."""
    for line in text.split("\n"):
        say(line)
