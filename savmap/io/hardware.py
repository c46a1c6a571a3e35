"""Which device decodes large video: a graphics processor where there is one, else the processor itself.

Decoders of H.264 and HEVC are exact by their standards, so that pictures are the same. SAVMAP_HARDWARE=off leaves devices alone;
SAVMAP_HARDWARE=cuda (or vaapi, videotoolbox, ...) tries that one only.
"""

import os
from collections.abc import Callable, Hashable, Sequence

import av.error
from av.codec.hwaccel import HWAccel, hwdevices_available

from savmap.errors import VideoError

VARIABLE = "SAVMAP_HARDWARE"
ORDER = ("videotoolbox", "cuda", "vaapi", "d3d11va", "qsv")
_FOUND: dict[Hashable, str | None] = {}


def candidates(wish: str, known: Sequence[str]) -> list[str]:
    """Kinds of device to try, best first, of those that FFmpeg was built with."""
    wanted = {"auto": ORDER, "": ORDER, "off": ()}.get(wish.lower(), (wish.lower(),))
    return [name for name in wanted if name in known]


def accelerator(kind: Hashable, decodes: Callable[[HWAccel], bool]) -> HWAccel | None:
    """A device for this kind of video, or None. The first on which `decodes` is true; that is found out once in a process.

    What a device that is not there, or not fit, raises counts as false.
    """
    wish = os.environ.get(VARIABLE, "auto")
    key = (wish, kind)
    if key not in _FOUND:
        names = candidates(wish, hwdevices_available())
        _FOUND[key] = next((name for name in names if _tried(name, decodes)), None)
    found = _FOUND[key]
    return None if found is None else HWAccel(found)


def _tried(name: str, decodes: Callable[[HWAccel], bool]) -> bool:
    try:
        return decodes(HWAccel(name, allow_software_fallback=False))
    except (VideoError, av.error.FFmpegError, OSError, RuntimeError, ValueError):
        return False
