"""What is no video at all, enormous things, and folders of broken pictures."""

import os
import struct
import zlib
from collections.abc import Mapping
from pathlib import Path

import av
import cv2
import numpy as np
from av.audio.stream import AudioStream
from broken import Maker, base, encode, picture, put, video_in

PLAYLISTS = (
    "#EXTM3U\n#EXT-X-TARGETDURATION:10\n#EXTINF:10,\n{}\n#EXT-X-ENDLIST\n",
    "ffconcat version 1.0\nfile {}\nfile {}\n",
    '<?xml version="1.0"?><MPD xmlns="urn:mpeg:dash:schema:mpd:2011" type="static"><Period/></MPD>\n',
    "v=0\no=- 0 0 IN IP4 127.0.0.1\nm=video 5004 RTP/AVP 96\na=rtpmap:96 H264/90000\n",
)


def _sound(folder: Path, rng: np.random.Generator) -> Path:
    codec, suffix = [("aac", "mp4"), ("pcm_s16le", "mov"), ("pcm_s16le", "mkv"), ("mp2", "ts")][int(rng.integers(4))]
    path = folder / f"sound.{suffix}"
    with av.open(str(path), "w") as container:
        stream = container.add_stream(codec, rate=44100)
        assert isinstance(stream, AudioStream)
        layout = av.AudioFrame.from_ndarray(rng.integers(-99, 99, (1, 44100), np.int16), format="s16", layout="mono")
        layout.sample_rate = 44100
        resampled = av.AudioResampler(
            stream.codec_context.format, "mono", 44100, stream.codec_context.frame_size or None
        )
        for frame in [*resampled.resample(layout), *resampled.resample(None)]:
            container.mux(stream.encode(frame))
        container.mux(stream.encode())
    return path


def _renamed_picture(folder: Path, rng: np.random.Generator) -> Path:
    kind = str(rng.choice([".jpg", ".png", ".bmp", ".webp", ".tiff"]))
    name = f"picture.{rng.choice(['mp4', 'mkv', 'mov', 'insv'])}"
    return put(folder, name, cv2.imencode(kind, picture(1))[1].tobytes())


def _renamed_text(folder: Path, rng: np.random.Generator) -> Path:
    words = bytes(rng.integers(32, 127, int(rng.integers(1, 4000)), np.uint8))
    return put(folder, f"text.{rng.choice(['mp4', 'mkv', 'mov', 'avi'])}", words)


def _playlist(folder: Path, rng: np.random.Generator) -> Path:
    """Lists that make FFmpeg open other files, in a video's name."""
    other = put(folder, "other.mp4", base("libx264", "mp4"))
    text = PLAYLISTS[int(rng.integers(len(PLAYLISTS)))]
    return put(folder, f"list.{rng.choice(['mp4', 'mkv', 'm3u8'])}", text.replace("{}", other.name).encode())


def _noise(folder: Path, rng: np.random.Generator) -> Path:
    heads = [
        b"",
        b"\0\0\1\xba",
        b"\0\0\1\xb3",
        b"RIFF\xff\xff\xff\xffAVI LIST",
        b"\x1a\x45\xdf\xa3",
        b"\0\0\0\1\x67",
        b"G",
    ]
    return put(folder, "noise.mp4", heads[int(rng.integers(len(heads)))] + rng.bytes(int(rng.integers(1, 400_000))))


def _zero_length(folder: Path, rng: np.random.Generator) -> Path:
    return put(folder, "empty.mp4", b"")


def _sparse(folder: Path, rng: np.random.Generator) -> Path:
    """Forty gigabytes of nothing, after some header or a whole video."""
    heads = [
        b"",
        base("libx264", "mp4"),
        base("libx264", "ts"),
        base("libx264", "mkv"),
        base("mpeg4", "avi"),
        b"\0\0\1\xba",
    ]
    head = heads[int(rng.integers(len(heads)))]
    path = put(folder, f"sparse.{rng.choice(['mp4', 'ts', 'mkv'])}", head)
    os.truncate(path, 40 * 2**30)
    return path


def _pipe(folder: Path, rng: np.random.Generator) -> Path:
    path = folder / "pipe.mp4"
    os.mkfifo(path)
    return path


def _endless(folder: Path, rng: np.random.Generator) -> Path:
    path = folder / "endless.mp4"
    path.symlink_to(str(rng.choice(["/dev/zero", "/dev/urandom", "/dev/full"])))
    return path


def _dangling(folder: Path, rng: np.random.Generator) -> Path:
    path = folder / "loop.mp4"
    path.symlink_to("loop.mp4" if rng.random() < 0.5 else "nothing.mp4")
    return path


def _enormous_video(folder: Path, rng: np.random.Generator) -> Path:
    """A real video of pictures far too large, all of one colour and so small as a file."""
    codec, suffix, size = [
        ("libx264", "mp4", (12288, 6144)),
        ("png", "mov", (20000, 10000)),
        ("mpeg4", "avi", (8190, 4095)),
    ][int(rng.integers(3))]
    path = folder / f"enormous.{suffix}"
    with av.open(str(path), "w") as container:
        stream = video_in(container, codec, size, "gray" if codec == "png" else "yuv420p")
        frame = av.VideoFrame(*size, stream.pix_fmt or "")
        for plane in frame.planes:
            plane.update(bytes(plane.buffer_size))
        container.mux(stream.encode(frame))
        container.mux(stream.encode())
    return path


def png(width: int, height: int, rows: int) -> bytes:
    """A grey PNG that says width x height and holds `rows` rows of nothing, deflated twice as small as it says."""

    def chunk(kind: bytes, content: bytes) -> bytes:
        return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content))

    squeeze = zlib.compressobj(9)
    content = b"".join(squeeze.compress(bytes(width + 1)) for _ in range(rows)) + squeeze.flush()
    head = struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", content) + chunk(b"IEND", b"")


def jpeg(index: int, said: tuple[int, int] | None = None) -> bytearray:
    """A picture as JPEG; `said`: the width and height that its header pretends."""
    data = bytearray(cv2.imencode(".jpg", picture(index)[..., ::-1])[1].tobytes())
    if said is not None:
        at = data.index(b"\xff\xc0") + 5
        data[at : at + 4] = struct.pack(">HH", said[1], said[0])
    return data


def _broken_picture(folder: Path, index: int, rng: np.random.Generator) -> None:
    suffix = str(rng.choice([".jpg", ".png", ".tiff", ".webp", ".bmp"]))
    data = bytearray(cv2.imencode(suffix, picture(index)[..., ::-1])[1].tobytes())
    name = f"{index:03}{suffix}"
    match int(rng.integers(9)):
        case 0:
            put(folder, name, data[: int(rng.integers(0, len(data)))])
        case 1:
            for at in rng.integers(0, len(data), 20):
                data[at] ^= 1 << int(rng.integers(8))
            put(folder, name, data)
        case 2:
            put(folder, name, rng.bytes(500))
        case 3:
            (folder / name).mkdir()
        case 4:
            (folder / name).symlink_to(name)
        case 5:
            put(folder, f"{index:03}.png", cv2.imencode(".png", picture(index, 64, 32))[1].tobytes())
        case 6:
            put(folder, f"{index:03}.jpg", jpeg(index, (64000, 32000)))
        case 7:
            put(folder, name, data[:100] + rng.bytes(len(data) - 100))
        case _:
            deep = picture(index).astype(np.uint16) * 200
            grey = deep[..., 0] if rng.random() < 0.5 else np.dstack([deep, deep[..., 0]])
            put(folder, f"{index:03}.png", cv2.imencode(".png", grey)[1].tobytes())


def _folder(folder: Path, rng: np.random.Generator) -> Path:
    inner = folder / "pictures"
    inner.mkdir()
    share = float(rng.choice([0.3, 0.9, 1.0]))
    for index in range(20):
        if rng.random() < share:
            _broken_picture(inner, index, rng)
        else:
            put(inner, f"{index:03}.png", cv2.imencode(".png", picture(index)[..., ::-1])[1].tobytes())
    return inner


def _bombs(folder: Path, rng: np.random.Generator) -> Path:
    """Pictures of a few kilobytes that say, and partly hold, a thousand million pixels."""
    inner = folder / "pictures"
    inner.mkdir()
    first = int(rng.integers(2))
    if first:
        put(inner, "000.png", cv2.imencode(".png", picture(0)[..., ::-1])[1].tobytes())
    width = int(rng.choice([46000, 60000, 32000]))
    put(inner, "001.png", png(width, width // 2, int(rng.choice([2, 4000]))))
    put(inner, "002.jpg", jpeg(2, (65000, 32500)))
    os.truncate(put(inner, "003.jpg", jpeg(3)), 8 * 2**30)
    return inner


def _empty_folder(folder: Path, rng: np.random.Generator) -> Path:
    inner = folder / "pictures"
    inner.mkdir()
    put(inner, "notes.txt", b"none")
    return inner


def _one_picture(folder: Path, rng: np.random.Generator) -> Path:
    inner = folder / "pictures"
    inner.mkdir()
    put(inner, "a.png", cv2.imencode(".png", picture(0))[1].tobytes())
    return inner


def _not_two_to_one(folder: Path, rng: np.random.Generator) -> Path:
    size = [(128, 128), (64, 128), (2, 2), (130, 64), (4000, 2)][int(rng.integers(5))]
    return encode(folder / "shape.mkv", "ffv1", count=3, size=size)


THINGS: Mapping[str, Maker] = {
    "sound only": _sound,
    "picture renamed": _renamed_picture,
    "text renamed": _renamed_text,
    "playlist renamed": _playlist,
    "noise": _noise,
    "nothing": _zero_length,
    "40 GB of nothing": _sparse,
    "named pipe": _pipe,
    "endless device": _endless,
    "dangling link": _dangling,
    "enormous pictures": _enormous_video,
    "not 2:1": _not_two_to_one,
    "folder of broken pictures": _folder,
    "folder of bombs": _bombs,
    "folder without pictures": _empty_folder,
    "folder of one picture": _one_picture,
}
