"""Videos as lists of pictures: read, written, and changed picture by picture."""

from collections.abc import Callable
from fractions import Fraction
from pathlib import Path

import av
import cv2
import numpy as np
from numpy.typing import NDArray

from savmap.geometry import pinhole
from savmap.geometry.sphere import panorama_pixels_from_rays, rays_from_panorama_pixels
from savmap.types import Floats
from savmap.video.reader import Clip, panoramas

Image = NDArray[np.uint8]
Frames = list[tuple[float, Image]]
"""Times (s) and RGB pictures."""
QUALITY, TICKS = {"crf": "14", "preset": "ultrafast", "g": "10"}, 90000


def read(video: Path) -> Frames:
    """All frames of a video."""
    return [(panorama.stamp_s, panorama.image) for panorama in panoramas(Clip(video, fps=1000.0))]


def write(path: Path, frames: Frames, streams: int = 1, degrees: float = 0.0) -> None:
    """A video of pictures with their times, in so many equal streams, that says that it is to be turned by `degrees`."""
    rate = Fraction(len(frames) - 1) / Fraction(frames[-1][0] - frames[0][0]).limit_denominator(TICKS)
    with av.open(str(path), "w") as container:
        opened = [
            container.add_stream("libx264", rate=rate.limit_denominator(1001), options=QUALITY) for _ in range(streams)
        ]
        for stream in opened:
            stream.height, stream.width, stream.pix_fmt = *frames[0][1].shape[:2], "yuv420p"
            stream.codec_context.time_base = Fraction(1, TICKS)
            stream.set_display_rotation(degrees)
        for stamp, picture in frames:
            for stream in opened:
                frame = av.VideoFrame.from_ndarray(np.ascontiguousarray(picture), format="rgb24")
                frame.pts, frame.time_base = round(stamp * TICKS), Fraction(1, TICKS)
                container.mux(stream.encode(frame))
        for stream in opened:
            container.mux(stream.encode())


def sampled(picture: Image, rays: Floats) -> Image:
    """The panorama's values (h, w, 3) in directions (h, w, 3)."""
    pixels = panorama_pixels_from_rays(rays, len(picture)).astype(np.float32)
    return np.asarray(cv2.remap(picture, pixels, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP), np.uint8)  # type: ignore[call-overload] # fmt: skip


def rays_of(width: int, height: int, wide: float) -> Floats:
    """Rays (height, width, 3) of an equirectangular picture `wide` radians wide."""
    longitude = wide * ((np.arange(width) + 0.5) / width - 0.5)
    latitude = np.pi * (0.5 - (np.arange(height) + 0.5) / height)[:, None]
    return np.stack(
        np.broadcast_arrays(
            np.cos(latitude) * np.sin(longitude), -np.sin(latitude), np.cos(latitude) * np.cos(longitude)
        ),
        axis=-1,
    )


def turned(yaw: float, pitch: float = 0.0, roll: float = 0.0) -> Callable[[Image], Image]:
    """As by a camera that is turned."""
    rotation = pinhole.rig_from_view(yaw, pitch, roll)

    def change(picture: Image) -> Image:
        height = len(picture)
        x, y = np.meshgrid(np.arange(2 * height), np.arange(height))
        return sampled(picture, rays_from_panorama_pixels(np.dstack([x, y]).astype(float), height) @ rotation.T)

    return change


def eyes(width: float, above: bool) -> Callable[[Image], Image]:
    """Two eyes' pictures in one, `width` radians wide each."""

    def change(picture: Image) -> Image:
        height = len(picture)
        size = (2 * height, height // 2) if above else (height, height)
        both = [sampled(picture, rays_of(*size, width) @ pinhole.rig_from_view(eye, 0, 0).T) for eye in (-1.2, 1.2)]
        return np.vstack(both) if above else np.hstack(both)

    return change


def two_fisheyes(picture: Image) -> Image:
    """Two lenses of 200 degrees, back to back."""
    height = len(picture)
    x, y = np.meshgrid(*2 * [(np.arange(height) + 0.5) / height * 2 - 1])
    radius = np.hypot(x, y)
    angle = radius * np.radians(100)
    rays = np.dstack([np.sin(angle) * x / radius, np.sin(angle) * y / radius, np.cos(angle)])
    lenses = [sampled(picture, rays @ pinhole.rig_from_view(turn, 0, 0).T) for turn in (0.0, 180.0)]
    return np.asarray(np.hstack([np.where(radius[..., None] < 1, lens, 0) for lens in lenses]), np.uint8)


def ordinary(picture: Image) -> Image:
    """A flat picture of 100 degrees."""
    height = len(picture)
    x, y = np.meshgrid((np.arange(2 * height) + 0.5) / height - 1, (np.arange(height) + 0.5) / height - 0.5)
    return sampled(picture, np.dstack([1.2 * x, 1.2 * y, np.ones_like(x)]))


def lit(gain: float, noise: float = 0.0) -> Callable[[Image], Image]:
    """As by another exposure, with noise."""
    rng = np.random.default_rng(4)
    return lambda picture: np.clip(
        picture * gain + (rng.normal(0, noise, picture.shape) if noise else 0.0), 0, 255
    ).astype(np.uint8)


def patched(picture: Image) -> Image:
    """With a tripod's patch and a logo below."""
    copy = picture.copy()
    copy[int(0.88 * len(copy)) :] = 20
    cv2.putText(copy, "CAMERA", (len(copy) // 2, int(0.97 * len(copy))), 0, len(copy) / 500, (255, 255, 255), 4)
    return copy


def seamed(picture: Image) -> Image:
    """Two lenses of different exposure."""
    gain = np.where(np.abs(np.arange(picture.shape[1]) / picture.shape[1] - 0.5) < 0.25, 0.8, 1.1)
    return np.clip(picture * gain[None, :, None], 0, 255).astype(np.uint8)


def smeared_lens(centre_deg: float, wide_deg: float, sigma: float) -> Callable[[Image], Image]:
    """A smear on a lens: a part of the panorama around a longitude is dull and blurred in all frames."""

    def change(picture: Image) -> Image:
        height, width = picture.shape[:2]
        blurred = cv2.GaussianBlur(picture, (0, 0), sigma * height / 1000)
        x, y = (np.arange(width) + 0.5) / width * 360 - 180, (np.arange(height) + 0.5) / height * 180 - 90
        away = np.hypot((x[None, :] - centre_deg + 180) % 360 - 180, y[:, None]) / wide_deg
        share = np.clip(2 - 2 * away, 0, 1)[..., None]
        return np.asarray(np.clip((1 - share) * picture + share * (0.7 * blurred + 50), 0, 255), np.uint8)

    return change


def out_of_focus(picture: Image) -> Image:
    """The whole panorama blurred by a three hundredth of its height."""
    return np.asarray(cv2.GaussianBlur(picture, (0, 0), len(picture) / 300), np.uint8)


def cropped(share: float) -> Callable[[Image], Image]:
    """Cut above and below by a share of the height, and stretched to 2:1 again."""

    def change(picture: Image) -> Image:
        height, width = picture.shape[:2]
        cut = round(share * height)
        return np.asarray(cv2.resize(picture[cut : height - cut], (width, height), interpolation=cv2.INTER_AREA))

    return change
