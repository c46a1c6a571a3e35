"""From a recording to its passes, a site file with a row for each side of each pass, and a contact sheet."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np

from savmap.apps.split.contact_sheet import THUMB_WIDTH, check_picture, contact_sheet, picture_stamps
from savmap.apps.split.frame_pairs import coarse_stamps, frame_pairs, pictures_at
from savmap.apps.split.passes import find_passes
from savmap.apps.split.records import SplitResult, SplitSettings
from savmap.apps.split.site_rows import add_to_site, check_new, new_site
from savmap.errors import StructureError, VideoError
from savmap.files.atomic import write_bytes
from savmap.files.yaml_text import path_text
from savmap.types.progress import Monitor, SilentMonitor
from savmap.video.clip import DecodeReport, Image, VideoInfo
from savmap.video.motion import WIDTH, FramePair, exposed_as, likeness, motion_of, strip_flow
from savmap.video.reader import probe

DEFAULTS = SplitSettings()
Span = tuple[float, float]


def watched(pairs: Iterable[FramePair], settings: SplitSettings, suspects: list[Span]) -> Iterator[FramePair]:
    """The pairs themselves; `suspects` gets the spans in which a recording may be cut: where the picture changes all at
    once, what was straight before need not be the same drive after."""
    last: FramePair | None = None
    for pair in pairs:
        if last is not None and alike(last.second, pair.first) < settings.suspect:
            suspects.append((last.stamp_s + last.gap_s, pair.stamp_s))
        last = pair
        yield pair


def split(
    recording: Path,
    output: Path = Path("site.yaml"),
    into: Path | None = None,
    sheet: Path | None = None,
    settings: SplitSettings = DEFAULTS,
    monitor: Monitor | None = None,
) -> SplitResult:
    """Find a recording's passes, and write them into a new site file, or into an existing one (`into`), with a contact
    sheet.

    Raises VideoError for a file that is no panoramic video, StructureError where no pass is found, SiteError and
    OutputError for files that are in the way or cannot be written.
    """
    path_text(str(recording.absolute()))  # a name that cannot be written is told at once
    if into is None:
        check_new(output)
    if sheet is not None:
        check_picture(sheet)
    result = find(recording, settings, monitor)
    if into is None:
        new_site(result.passes, recording, output)
    else:
        add_to_site(result.passes, recording, into)
    if sheet is not None:
        stamps = [stamp for detected in result.passes for stamp in picture_stamps(detected)]
        pictures = pictures_at(probe(recording), stamps, THUMB_WIDTH)
        write_bytes(sheet, contact_sheet(result.passes, pictures, result.stamps_s, result.travel_deg))
    return result


def find(recording: Path, settings: SplitSettings = DEFAULTS, monitor: Monitor | None = None) -> SplitResult:
    """The passes of a recording: sampled coarsely, then more finely where passes begin and end.

    Raises VideoError for a file that is no panoramic video, StructureError where no pass is found.
    """
    info = probe(recording)
    if info.codec == "images":
        raise VideoError(f"{recording}: is a folder of pictures; only a video is split into passes")
    report, monitor = DecodeReport(), monitor or SilentMonitor()
    suspects, coarse_s = list[Span](), coarse_stamps(info, settings.every_s)
    pairs = watched(frame_pairs(info, coarse_s, settings, report), settings, suspects)
    motions = [motion_of(pair) for pair in monitor.each(pairs, "looking for passes", len(coarse_s))]
    if len(motions) < 2:
        raise VideoError(
            f"{recording}: no two frames {settings.apart_s:g} s apart can be decoded; the file is cut off or damaged"
        )
    cuts_s = cuts(info, suspects, settings)
    coarse = find_passes(motions, settings, cuts_s)
    ends = [end for detected in coarse.passes for end in (detected.start_s, detected.end_s)]
    stamps = [motion.stamp_s for motion in motions]
    wanted = set[float]()
    for before, after in pairwise(stamps):
        if any(before - settings.every_s / 2 < end < after + settings.every_s / 2 for end in ends):
            parts = round((after - before) / settings.closer_s)
            wanted |= {round(before + (after - before) * part / parts, 3) for part in range(1, parts)}
    closer = sorted(wanted)
    pairs = frame_pairs(info, closer, settings, report)
    motions += [motion_of(pair) for pair in monitor.each(pairs, "looking closer at their ends", len(closer))]
    by_time = sorted({motion.stamp_s: motion for motion in motions}.items())
    result = find_passes([motion for _, motion in by_time], settings, cuts_s)
    if not result.passes:
        raise StructureError(
            f"{recording}: no pass was found: nowhere does the camera go straight for {settings.least_s:g} s or more "
            "with structure close beside it; is it a drive through aisles, in equirectangular video?"
        )
    frames = round(info.duration_s * info.rate_fps)
    return replace(result, frame_pairs=report.used, frames_decoded=report.decoded, frames=frames)


def alike(first: Image, second: Image) -> float:
    """How alike two grey panoramas are, 0 to 1, once the camera's motion is allowed for."""
    a, b = (
        cv2.resize(image, (WIDTH, WIDTH // 2), interpolation=cv2.INTER_AREA).astype(np.uint8)
        for image in (first, second)
    )
    return likeness(strip_flow(FramePair(0.0, 1.0, a, exposed_as(b, a))))


def cuts(info: VideoInfo, suspects: Sequence[Span], settings: SplitSettings) -> list[float]:
    """The times, s, of the cuts within spans in which one is suspected, from more pictures there."""
    times = []
    for start, end in suspects:
        parts = max(1, round((end - start) / settings.closer_s))
        stamps = [start + (end - start) * part / parts for part in range(parts + 1)]
        greys = [
            cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY).astype(np.uint8) for picture in pictures_at(info, stamps, WIDTH)
        ]
        steps = [alike(first, second) for first, second in pairwise(greys)]
        worst = int(np.argmin(steps))
        if steps[worst] < settings.cut:
            times.append((stamps[worst] + stamps[worst + 1]) / 2)
    return times
