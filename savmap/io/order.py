"""Time stamps that damage has touched, told from those that run on."""

from collections.abc import Iterator
from typing import TypeVar

Frame = TypeVar("Frame")

LEAP_S = 10.0
LEAP_FRAMES = 20
BELIEVED_AFTER = 5


def in_order(
    frames: Iterator[tuple[float, Frame]], start_s: float, rate_fps: float
) -> Iterator[tuple[float, Frame, bool]]:
    """Frames with their times (s), and whether each follows the one before it that did.

    A time that is not after the last one does not follow. Nor does one that leaps ahead by more than LEAP_S or LEAP_FRAMES
    frames' time, until BELIEVED_AFTER in a row have leapt: then the recording has a gap. The first is measured from `start_s`.
    """
    leap_s = max(LEAP_S, LEAP_FRAMES / rate_fps if rate_fps > 0 else 0.0)
    last, ahead, begun = start_s, 0, False
    for stamp, frame in frames:
        leapt = stamp > last + leap_s
        ahead = ahead + 1 if leapt else 0
        follows = (stamp > last or not begun) and (not leapt or ahead > BELIEVED_AFTER)
        if follows:
            last, begun, ahead = stamp, True, 0
        yield stamp, frame, follows
