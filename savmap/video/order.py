"""The order of a recording's times: which frames follow the one before, and where the times of another recording
begin."""

from collections.abc import Iterator
from typing import TypeVar

from savmap.errors import VideoError
from savmap.video.clip import VideoInfo

Frame = TypeVar("Frame")

LEAP_S = 10.0
LEAP_FRAMES = 20
BELIEVED_AFTER = 5


def in_order(
    frames: Iterator[tuple[float, Frame]], start_s: float, info: VideoInfo
) -> Iterator[tuple[float, Frame, bool]]:
    """Frames with their times (s), and whether each follows the last one that did.

    A time that is not after the last one does not follow. Nor does one that leaps ahead by more than LEAP_S or
    LEAP_FRAMES frames' time, until BELIEVED_AFTER in a row have leapt: then the recording has a gap. The first is
    measured from `start_s`. Raises VideoError where more than BELIEVED_AFTER in a row lie before the last one that
    followed, and go on from there: they are of another recording.
    """
    leap_s = max(LEAP_S, LEAP_FRAMES / info.rate_fps if info.rate_fps > 0 else 0.0)
    last, before, leaps, backs, begun = start_s, start_s, 0, 0, False
    for stamp, frame in frames:
        leapt = stamp > last + leap_s
        leaps = leaps + 1 if leapt else 0
        is_back = begun and stamp < last
        backs = backs + 1 if is_back and stamp > before else int(is_back)
        if backs > BELIEVED_AFTER:
            raise VideoError(several_recordings(info, f"the times begin again after {last:.1f} s"))
        follows = (stamp > last or not begun) and (not leapt or leaps > BELIEVED_AFTER)
        if follows:
            last, begun, leaps = stamp, True, 0
        before = stamp
        yield stamp, frame, follows


def several_recordings(info: VideoInfo, seen: str) -> str:
    """What to say of a file in which one recording follows another, by what is seen of it."""
    return (
        f"{info.path}: holds two recordings, one behind the other: {seen}; give each as a file of its own (of a transport stream, "
        "`ffmpeg -i OLD -c copy NEW.mkv` makes the times go on: give each as a pass of its own, up to that time and from there)"
    )
