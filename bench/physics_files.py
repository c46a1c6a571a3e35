"""The same pictures in the files that cameras, telephones and editing programs give: cases for `physics_footage.py`."""

from physics_videos import Frames
from physics_ways import Case

X265 = {"crf": "16", "preset": "ultrafast", "x265-params": "log-level=none:keyint=30"}


def as_they_are(frames: Frames, _: Frames) -> Frames:
    return frames


def jittered(frames: Frames, _: Frames) -> Frames:
    """Times that a telephone gives: each off by up to a third of a frame."""
    step = frames[1][0] - frames[0][0]
    return [
        (stamp + step * (0.0, 0.31, -0.22, 0.12, -0.3, 0.05)[index % 6], one)
        for index, (stamp, one) in enumerate(frames)
    ]


def drawn_out(frames: Frames, _: Frames) -> Frames:
    """Times of 30000/1001 Hz and its fifths."""
    return [(index * 5 * 1001 / 30000, one) for index, (_, one) in enumerate(frames)]


FILES = (
    Case("HEVC, 8 bit", as_they_are, container={"codec": "libx265", "stream": X265}),
    Case(
        "HEVC, 10 bit, BT.2020",
        as_they_are,
        container={"codec": "libx265", "pixels": "yuv420p10le", "stream": X265, "matrix": 9},
    ),
    Case("full range, said so, BT.709", as_they_are, container={"full": True, "says_full": True, "matrix": 1}),
    Case("full range, not said", as_they_are, container={"full": True, "says_full": False}),
    Case("limited range, said to be full", as_they_are, container={"full": False, "says_full": True}),
    Case(
        "8 Mbit/s at 30 Hz", as_they_are, container={"stream": {"preset": "medium", "g": "30"}, "bit_rate": 1_600_000}
    ),
    Case("times jitter", jittered),
    Case("29.97 Hz", drawn_out),
    Case(
        "B frames, edit list",
        as_they_are,
        container={"stream": {"crf": "16", "preset": "medium", "bf": "3", "g": "12"}},
    ),
    Case(
        "edit list cuts 0.5 s",
        as_they_are,
        container={"stream": {"crf": "16", "preset": "medium", "bf": "2", "g": "40"}, "start_s": -0.5},
    ),
    Case(
        "sound and a time code track",
        as_they_are,
        container={"sound": True, "timecode": "01:00:00:00", "suffix": ".mov"},
    ),
    Case(
        "sound, begins at 1 h",
        as_they_are,
        container={"sound": True, "start_s": 3600.0, "suffix": ".mov", "muxer": {"use_editlist": "0"}},
    ),
    Case("begins at 1 h, edit list", as_they_are, container={"start_s": 3600.0, "suffix": ".mov"}),
    Case("Matroska", as_they_are, container={"suffix": ".mkv"}),
    Case("Matroska, says 30 Hz", as_they_are, container={"suffix": ".mkv", "rate": 30}),
    Case("Matroska, begins at 1 h", as_they_are, container={"suffix": ".mkv", "start_s": 3600.0}),
    Case("transport stream", as_they_are, container={"suffix": ".ts"}),
    Case(
        "fragmented MP4", as_they_are, container={"muxer": {"movflags": "frag_keyframe+empty_moov+default_base_moof"}}
    ),
    Case(
        "ProRes 4:2:2, 10 bit",
        as_they_are,
        container={"suffix": ".mov", "codec": "prores_ks", "pixels": "yuv422p10le", "stream": {"profile": "2"}},
    ),
)
