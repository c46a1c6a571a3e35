"""Cuts in a recording: where the picture changes all at once, and what was straight before need not be the same drive
after."""

from collections.abc import Iterable, Iterator, Sequence
from itertools import pairwise

import cv2
import numpy as np

from savmap.split.frame_pairs import pictures_at
from savmap.split.records import SplitSettings
from savmap.video.clip import Image, VideoInfo
from savmap.video.footage.corridor import FramePair, strip_flow
from savmap.video.footage.watch import WIDTH, exposed_as, likeness

Span = tuple[float, float]


class CutWatch:
    """Watches the pairs of a recording go by, in order, and notes where one is not like the one before."""

    def __init__(self, settings: SplitSettings) -> None:
        self.settings = settings
        self.suspects: list[Span] = []
        self._last: FramePair | None = None

    def over(self, pairs: Iterable[FramePair]) -> Iterator[FramePair]:
        """The pairs themselves."""
        for pair in pairs:
            if self._last is not None and alike(self._last.second, pair.first) < self.settings.suspect:
                self.suspects.append((self._last.stamp_s + self._last.gap_s, pair.stamp_s))
            self._last = pair
            yield pair


def alike(first: Image, second: Image) -> float:
    """How alike two grey panoramas are, 0 to 1, once the camera's motion is allowed for."""
    a, b = (
        cv2.resize(image, (WIDTH, WIDTH // 2), interpolation=cv2.INTER_AREA).astype(np.uint8)
        for image in (first, second)
    )
    return likeness(strip_flow(FramePair(0.0, 1.0, a, exposed_as(b, a))))


def cuts(info: VideoInfo, suspects: Sequence[Span], settings: SplitSettings) -> list[float]:
    """The times, s, of the cuts within spans in which one is suspected, from more pictures there."""
    found = []
    for start, end in suspects:
        parts = max(1, round((end - start) / settings.closer_s))
        stamps = [start + (end - start) * part / parts for part in range(parts + 1)]
        greys = [
            cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY).astype(np.uint8) for picture in pictures_at(info, stamps, WIDTH)
        ]
        steps = [alike(first, second) for first, second in pairwise(greys)]
        worst = int(np.argmin(steps))
        if steps[worst] < settings.cut:
            found.append((stamps[worst] + stamps[worst + 1]) / 2)
    return found
