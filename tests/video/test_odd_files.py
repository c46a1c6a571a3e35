"""Sound videos that are easily misread: odd names, two recordings in one file; and what is said of files that are no videos."""

import io
import subprocess
import sys
from fractions import Fraction
from pathlib import Path

import av
import pytest
from PIL import Image

import savmap
from savmap.apps.split.frame_pairs import coarse_stamps, pictures_at
from savmap.errors import VideoError
from savmap.video.clip import Clip, DecodeReport
from savmap.video.reader import check_camera, panoramas, preview_frames, probe

from .made_up_video import evenly, picture, write_recording, write_video

LIMITED = """
import resource, sys
from pathlib import Path
from savmap.video.reader import Clip, panoramas, probe
clip, kept = Clip(Path(sys.argv[1]), end_s=3), []
probe(clip.path)
used = int(open("/proc/self/statm").read().split()[0]) * resource.getpagesize()
resource.setrlimit(resource.RLIMIT_AS, (used + (int(sys.argv[2]) << 20),) * 2)
try:
    kept.extend(panoramas(clip))
except MemoryError:
    print("MemoryError")
"""
NAMES = [
    "2024-05-01T10:00:00.mp4",
    "a%03d?#1.mp4",
    "-a.mp4",
    "concat:a.mp4|b.mp4",
    "file:a.mp4",
    "fd:",
    "a\n.mp4",
]


@pytest.fixture(scope="module")
def video(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_video(tmp_path_factory.mktemp("video") / "a.mp4", evenly(12, 15))


@pytest.mark.parametrize("name", NAMES)
def test_any_name_is_that_of_a_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, video: Path, name: str) -> None:
    (tmp_path / name).write_bytes(video.read_bytes())
    monkeypatch.chdir(tmp_path)
    path = Path(name)
    info = probe(path)
    check_camera(Clip(path), info)
    assert len(list(panoramas(Clip(path)))) == 12
    assert len(preview_frames(Clip(path), keys=3, pairs=1)[0]) == 3
    assert len(pictures_at(info, coarse_stamps(info, 0.2), 32)) >= 4


def half_a_heif() -> bytes:
    """A picture in boxes as those of MP4, cut off."""
    file = io.BytesIO()
    Image.fromarray(picture(0)).save(file, "avif")
    return file.getvalue()[: file.getvalue().index(b"meta") + 20]


def index_of(data: bytes) -> int:
    return data.index(b"moov") - 4


def test_what_is_wrong_with_a_file_is_what_is_said_of_it(tmp_path: Path, video: Path) -> None:
    whole = video.read_bytes()
    spoilt = bytearray(whole)
    spoilt[spoilt.index(b"stsc") - 4 : spoilt.index(b"stsc")] = b"\xff\xff\xff\xff"
    jpeg = io.BytesIO()
    Image.fromarray(picture(0)).save(jpeg, "jpeg")
    told = {
        "is cut off or damaged (its index is missing); copy it from the camera again": whole[: index_of(whole)],
        "its index is missing": whole[whole.index(b"mdat") - 4 : index_of(whole)],
        "cannot be opened; FFmpeg says: Invalid data": bytes(spoilt),
        "is one picture, not a video": jpeg.getvalue(),
        "is one picture, not a video; give a video, or a folder of pictures": half_a_heif(),
        "not a video file of a kind that is read (see docs/video.md)": b"PK\3\4" + bytes(range(256)),
    }
    for words, content in told.items():
        (tmp_path / "10:00.mp4").write_bytes(content)
        with pytest.raises(VideoError) as caught:
            probe(tmp_path / "10:00.mp4")
        assert words in str(caught.value)
        assert ("index" in str(caught.value)) == ("index" in words)
        assert "\n" not in str(caught.value)


FORMATS = {
    "mpegts": ("libx264", {}),
    "mpeg": ("mpeg2video", {}),
    "matroska": ("libx264", {}),
    "mp4": ("libx264", {"movflags": "frag_keyframe+empty_moov"}),
}


@pytest.mark.parametrize("kind", FORMATS)
@pytest.mark.parametrize("counts", [(50, 75), (75, 50)])
def test_a_recording_behind_another_is_refused_at_once(tmp_path: Path, kind: str, counts: tuple[int, int]) -> None:
    codec, options = FORMATS[kind]
    parts = [
        write_recording(tmp_path / "part", count, codec, kind, options, 100 * part).read_bytes()
        for part, count in enumerate(counts)
    ]
    joined = tmp_path / "joined"
    joined.write_bytes(b"".join(parts))
    with pytest.raises(VideoError, match="holds two recordings, one behind the other: the times begin again") as caught:
        probe(joined)
    after = float(str(caught.value).split("begin again after ")[1].split(" s")[0])
    assert after == pytest.approx(counts[0] / 25, abs=0.2)
    assert "\n" not in str(caught.value)
    joined.write_bytes(parts[0])
    assert probe(joined).duration_s == pytest.approx(counts[0] / 25, abs=0.4)


def test_what_follows_a_whole_mp4_is_told(tmp_path: Path, video: Path) -> None:
    (tmp_path / "joined.mp4").write_bytes(2 * video.read_bytes())
    with pytest.raises(VideoError, match=r"holds two recordings.*: what follows after 0\.8 s is never read"):
        probe(tmp_path / "joined.mp4")


def test_times_that_begin_again_are_told_while_decoding(tmp_path: Path) -> None:
    """In one Matroska segment, which shows nothing of it from outside: half of it is not taken for damaged."""
    path = tmp_path / "a.mkv"
    with av.open(str(path), "w") as container:
        stream = container.add_stream("mjpeg", rate=25)
        stream.width, stream.height, stream.pix_fmt = 128, 64, "yuvj420p"
        for index in range(60):
            frame = av.VideoFrame.from_ndarray(picture(index), format="rgb24")
            frame.pts, frame.time_base = index, Fraction(1, 25)
            for packet in stream.encode(frame):
                packet.dts, packet.pts = index, 200 + (index if index < 30 else index - 30)
                container.mux(packet)
    report = DecodeReport()
    with pytest.raises(VideoError, match=r"the times begin again after 1\.2 s"):
        list(panoramas(Clip(path, fps=25), report=report))
    assert report.used == 30


def test_a_recording_that_counts_on_is_one(tmp_path: Path) -> None:
    """A stream whose times run over their 33 bits, and one with a gap."""
    over = 2**33 / 90000 - 1
    for stamps in (
        [over + stamp for stamp in evenly(60, 30)],
        [*evenly(30, 30), *(4 + stamp for stamp in evenly(30, 30))],
    ):
        path = write_video(tmp_path / "a.ts", stamps)
        report = DecodeReport()
        assert len(list(panoramas(Clip(path, fps=30), report=report))) == 60
        assert report.skipped == 0


def test_damage_is_no_damage_where_memory_is_short(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, video: Path
) -> None:
    whole = bytearray(video.read_bytes())
    middle = (whole.index(b"mdat") + whole.index(b"moov")) // 2
    whole[middle : middle + 200] = bytes(200)
    (tmp_path / "a.mp4").write_bytes(whole)
    assert 0 < len(list(panoramas(Clip(tmp_path / "a.mp4")))) < 12

    def none(width: int, height: int) -> None:
        raise MemoryError((width, height))

    monkeypatch.setattr("savmap.video.decode.require_memory", none)
    with pytest.raises(MemoryError, match=r"128, 64"):
        list(panoramas(Clip(tmp_path / "a.mp4")))


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="macOS has no limit of a process's addresses")
@pytest.mark.parametrize("left_mb", [4, 32])
def test_a_limit_of_memory_is_no_damage(left_mb: int) -> None:
    video = Path(savmap.__file__).with_name("demo") / "aisle-dev.mp4"
    done = subprocess.run([sys.executable, "-c", LIMITED, str(video), str(left_mb)], capture_output=True, check=True)
    assert done.stdout == b"MemoryError\n"
