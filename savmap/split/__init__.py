"""`savmap split`: the passes in a long recording in which a cart weaves through aisles, found by looking at little of it."""

from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

from savmap.errors import StructureError, VideoError
from savmap.split.glances import GlanceReport, coarse_stamps, glances, pictures_at
from savmap.split.motion import Motion, motion_of
from savmap.split.passes import Found, find_passes
from savmap.split.records import PassFound
from savmap.split.settings import Settings
from savmap.split.sheet import THUMB_WIDTH, check_picture, clock, contact_sheet, stamps_of, write_picture
from savmap.split.sitetext import add_to_site, check_new, new_site
from savmap.types.progress import Monitor, SilentMonitor
from savmap.video.clip import VideoInfo
from savmap.video.reader import probe

DEFAULTS = Settings()

__all__ = ["DEFAULTS", "Found", "GlanceReport", "PassFound", "Settings", "find", "split"]


def split(
    recording: Path,
    output: Path = Path("site.yaml"),
    into: Path | None = None,
    sheet: Path | None = None,
    settings: Settings = DEFAULTS,
    monitor: Monitor | None = None,
) -> Iterator[str]:
    """Finds a recording's passes and writes them into a new site file, or `into` one; lines to print.

    Raises VideoError for what is no panoramic video, StructureError where no pass is found, SiteError and OutputError for
    files that are in the way or cannot be written.
    """
    if into is None:
        check_new(output)
    if sheet is not None:
        check_picture(sheet)
    report = GlanceReport()
    found = find(recording, settings, monitor, report)
    yield from _table(found.passes)
    if into is None:
        new_site(found.passes, recording, output)
    else:
        add_to_site(found.passes, recording, into)
    yield f"wrote {into or output}: look through it before mapping"
    if sheet is not None:
        stamps = [stamp for one in found.passes for stamp in stamps_of(one)]
        pictures = pictures_at(probe(recording), stamps, THUMB_WIDTH)
        write_picture(contact_sheet(found.passes, pictures, found.stamps_s, found.travel_deg), sheet)
        yield f"wrote {sheet}"
    yield f"{report.decoded} frames decoded for {report.glances} glances, {report.share(probe(recording)):.0%} of the recording"


def find(
    recording: Path,
    settings: Settings = DEFAULTS,
    monitor: Monitor | None = None,
    report: GlanceReport | None = None,
) -> Found:
    """The passes of a recording: a first look at all of it, then a closer one where passes begin and end.

    Raises VideoError for what is no panoramic video, StructureError where no pass is found.
    """
    info = probe(recording)
    if info.codec == "images":
        raise VideoError(f"{recording}: is a folder of pictures; only a video is split into passes")
    report = GlanceReport() if report is None else report
    monitor = monitor or SilentMonitor()
    motions = _look(info, coarse_stamps(info, settings.every_s), settings, report, monitor, "looking for passes")
    if len(motions) < 2:
        raise VideoError(
            f"{recording}: no two frames {settings.apart_s:g} s apart can be decoded; the file is cut off or damaged"
        )
    first = find_passes(motions, settings)
    closer = _closer_stamps(first.passes, motions, settings)
    motions += _look(info, closer, settings, report, monitor, "looking closer at their ends")
    found = find_passes(_in_order(motions), settings)
    if not found.passes:
        raise StructureError(
            f"{recording}: no pass was found: nowhere does the camera go straight for {settings.least_s:g} s or more with "
            "structure close beside it; is it a drive through aisles, in equirectangular video?"
        )
    return found


def _look(
    info: VideoInfo, stamps_s: list[float], settings: Settings, report: GlanceReport, monitor: Monitor, doing: str
) -> list[Motion]:
    seen = glances(info, stamps_s, settings, report)
    return [motion_of(one) for one in monitor.each(seen, doing, len(stamps_s))]


def _closer_stamps(passes: tuple[PassFound, ...], motions: list[Motion], settings: Settings) -> list[float]:
    """Times around the passes' ends, between the samples there."""
    ends = [end for one in passes for end in (one.start_s, one.end_s)]
    stamps = [one.stamp_s for one in motions]
    wanted = set[float]()
    for before, after in pairwise(stamps):
        if any(before - settings.every_s / 2 < end < after + settings.every_s / 2 for end in ends):
            parts = round((after - before) / settings.closer_s)
            wanted |= {round(before + (after - before) * part / parts, 3) for part in range(1, parts)}
    return sorted(wanted)


def _in_order(motions: list[Motion]) -> list[Motion]:
    """Sorted by time, each time once."""
    return [one for _, one in sorted({one.stamp_s: one for one in motions}.items())]


def _table(passes: tuple[PassFound, ...]) -> Iterator[str]:
    yield "pass     start       end   heading  sides        confidence"
    for number, one in enumerate(passes, start=1):
        sides = " and ".join(one.sides)
        yield (
            f"{number:4d}  {clock(one.start_s):>8}  {clock(one.end_s):>8}  {one.heading_deg:+6.0f}"
            f"    {sides:<14} {one.confidence:4.2f}"
        )
