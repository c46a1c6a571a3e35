"""What the command line prints: text of any origin, of which no character but a line's end does anything to the
terminal."""

import sys

from savmap.errors import visible
from savmap.types import SiteMap


def say(line: object, err: bool = False) -> None:
    """Print one line."""
    print(visible(str(line)), file=sys.stderr if err else sys.stdout, flush=True)


def say_all(text: str) -> None:
    """Print several lines."""
    for line in text.split("\n"):
        say(line)


def say_banner(site_map: SiteMap) -> None:
    """What a file that was written of a map, or a figure of it, does not show: the rows that it lacks, and those that
    are to be checked first."""
    if site_map.banner:
        say(f"note: {site_map.banner} (`savmap view`, report.html)")
