"""Random variation of labelled pictures, so that a network learns shapes and not the colours of one renderer.

Endless batches of them are prepared by threads while the network computes.
"""

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from itertools import count, islice

import cv2
import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from savmap.lab.train.data.dataset import IGNORE, Sample

Bytes = NDArray[np.uint8]
Image = NDArray[np.float32]
"""(H, W, 3), RGB, 0..1."""


@dataclass(frozen=True)
class Crop:
    """Size of a training crop in pixels (multiples of 32) and range of its magnification."""

    width: int = 384
    height: int = 288
    smallest: float = 0.6
    largest: float = 1.7


def random_homography(rng: Generator, crop: Crop, width: int, height: int) -> NDArray[np.float64]:
    """(3, 3) from picture to crop pixels: magnify, turn, stretch, tilt and mirror about a random point."""
    scale = np.exp(rng.uniform(np.log(crop.smallest), np.log(crop.largest)))
    stretch = np.exp(rng.normal(0, 0.08))
    angle = np.radians(rng.normal(0, 2.5))
    reach_x = max(0.0, width - crop.width / scale) / 2 + 20
    reach_y = max(0.0, height - crop.height / scale) / 2 + 20
    centre = np.array(
        [(width - 1) / 2 + rng.uniform(-reach_x, reach_x), (height - 1) / 2 + rng.uniform(-reach_y, reach_y)]
    )
    to_centre = np.array([[1, 0, -centre[0]], [0, 1, -centre[1]], [0, 0, 1]])
    turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    mirror = -1.0 if rng.random() < 0.5 else 1.0
    sizes = np.diag([mirror * scale * stretch, scale / stretch, 1.0])
    tilt = np.eye(3)
    tilt[2, :2] = rng.normal(0, 0.12, 2) / max(crop.width, crop.height)
    back = np.array([[1, 0, (crop.width - 1) / 2], [0, 1, (crop.height - 1) / 2], [0, 0, 1.0]])
    crop_from_image: NDArray[np.float64] = back @ tilt @ turn @ sizes @ to_centre
    return crop_from_image


def warp(
    image: Bytes, mask: Bytes, crop_from_image: NDArray[np.float64], crop: Crop, classes: int
) -> tuple[Image, Bytes]:
    """Resample picture and mask; the mask class by class with interpolation, so that its edges do not move or fray."""
    size = (crop.width, crop.height)
    picture = cv2.warpPerspective(
        image, crop_from_image, size, flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT_101
    )
    values = (0, *range(1, classes + 1), IGNORE)
    shares = [((mask == value) * np.uint8(255)).astype(np.uint8) for value in values]
    outside = [0] * (classes + 1) + [255]
    warped = [
        cv2.warpPerspective(share, crop_from_image, size, flags=cv2.INTER_LINEAR, borderValue=(border,))
        for share, border in zip(shares, outside, strict=True)
    ]
    winner = np.array(values, np.uint8)[np.argmax(warped, axis=0)]
    return (picture / np.float32(255)).astype(np.float32), winner


def luminance(image: Image) -> Image:
    """(H, W, 1) brightness."""
    return np.asarray(image @ np.array([0.299, 0.587, 0.114], np.float32), np.float32)[:, :, None]


def turned_hue(image: Image, degrees: float, saturation: float) -> Image:
    """The picture with its hue turned (a rotation about the grey axis) and its saturation changed."""
    rotation = Rotation.from_rotvec(np.radians(degrees) * np.full(3, 1 / np.sqrt(3))).as_matrix()
    grey = np.full((3, 3), 1 / 3)
    matrix = (grey + saturation * (rotation - grey)).astype(np.float32)
    return np.asarray(image @ matrix.T, np.float32)


def painted(image: Image, colour: NDArray[np.float32]) -> Image:
    """The picture in shades of one colour, keeping its light and shade."""
    bright = luminance(image)
    return bright / max(float(bright.mean()), 0.05) * colour


def random_paint(rng: Generator, region: Image) -> Image:
    """A region repainted: another hue, one colour throughout, or only lighter or darker."""
    kind = rng.random()
    if kind < 0.45:
        return turned_hue(region, rng.uniform(-180, 180), rng.uniform(0.3, 1.6)) * np.float32(rng.uniform(0.5, 1.5))
    if kind < 0.75:
        colour = rng.uniform(0.03, 0.95, 3).astype(np.float32)
        return painted(region, colour)
    return region * np.float32(rng.uniform(0.35, 1.9))


OVEREXPOSED = 0.85
MOST_UNKNOWN = 0.1


def recolour(rng: Generator, image: Image, mask: Bytes, classes: int) -> Image:
    """Repaint every class, and the background, each on its own; borders blend over a pixel as they do in a camera.

    A class that shines here (overexposed on average) is left alone: paint does not change what a lamp looks like. So is
    one that ends where labels end for more than a tenth of its border: the paint would show the network where that is.
    """
    result = image
    for value in range(classes + 1):
        share = (mask == value).astype(np.float32)
        if rng.random() < 0.6 and share.any() and not _ends_with_labels(mask, value):
            soft = cv2.GaussianBlur(share, (3, 3), 0.6)[:, :, None]
            flat = image[mask == value].mean(axis=0)
            if value > 0 and flat.mean() > OVEREXPOSED:
                continue
            region = image if value == 0 else image * soft + flat * (1 - soft)
            result = result * (1 - soft) + random_paint(rng, region.astype(np.float32)) * soft
    return result.astype(np.float32)


def _ends_with_labels(mask: Bytes, value: int) -> bool:
    """Whether much of what borders on a class is not judged."""
    inside = (mask == value).astype(np.uint8)
    around = mask[cv2.dilate(inside, np.ones((3, 3), np.uint8)) > inside]
    return bool(np.mean(around == IGNORE) > MOST_UNKNOWN) if len(around) else False


def smooth_field(rng: Generator, height: int, width: int, cells: int) -> Image:
    """(height, width, 1) slowly varying, roughly normal with deviation 1."""
    coarse = rng.normal(0, 1, (cells, cells)).astype(np.float32)
    return np.asarray(cv2.resize(coarse, (width, height), interpolation=cv2.INTER_CUBIC), np.float32)[:, :, None]


def uneven_lighting(rng: Generator, image: Image) -> Image:
    """Pools of light and shadow, and a lens darker towards its corners."""
    height, width = image.shape[:2]
    field = np.exp(smooth_field(rng, height, width, int(rng.integers(2, 6))) * rng.uniform(0.05, 0.45))
    return np.asarray(image * field, np.float32)


def tone(rng: Generator, image: Image) -> Image:
    """Exposure, white balance, contrast and gamma."""
    gains = np.exp(rng.normal(0, 0.25) + rng.normal(0, 0.1, 3)).astype(np.float32)
    balanced = np.clip(image * gains, 0, 1)
    curved = balanced ** np.float32(np.exp(rng.normal(0, 0.25)))
    pivot = np.float32(curved.mean())
    contrast, lift = np.exp(rng.normal(0, 0.2)), rng.normal(0, 0.04)
    return np.asarray((curved - pivot) * np.float32(contrast) + pivot + np.float32(lift), np.float32)


def colour(rng: Generator, image: Image) -> Image:
    """Hue and saturation of the whole picture; now and then without any colour."""
    if rng.random() < 0.12:
        return np.repeat(luminance(image), 3, axis=2)
    return turned_hue(image, rng.normal(0, 25) if rng.random() < 0.6 else rng.uniform(-180, 180), rng.uniform(0.4, 1.5))


def blurred(rng: Generator, image: Image) -> Image:
    """Defocus, sideways motion, or a lower resolution scaled up."""
    kind = rng.random()
    if kind < 0.5:
        return cv2.GaussianBlur(image, (0, 0), rng.uniform(0.3, 1.2)).astype(np.float32)
    if kind < 0.75:
        length = int(rng.integers(2, 5)) * 2 - 1
        return cv2.blur(image, (length, 1)).astype(np.float32)
    height, width = image.shape[:2]
    factor = rng.uniform(0.5, 0.9)
    small = cv2.resize(image, (round(width * factor), round(height * factor)), interpolation=cv2.INTER_AREA)
    return cv2.resize(small, (width, height), interpolation=cv2.INTER_LINEAR).astype(np.float32)


def sharpened(rng: Generator, image: Image) -> Image:
    """The halo that cameras add along edges."""
    return image + np.float32(rng.uniform(0.2, 1.0)) * (image - cv2.GaussianBlur(image, (0, 0), 1.0))


def noisy(rng: Generator, image: Image) -> Image:
    """Sensor noise, coarse or fine."""
    height, width = image.shape[:2]
    coarse = rng.random() < 0.3
    shape = (height // 2, width // 2, 3) if coarse else (height, width, 3)
    noise = rng.standard_normal(shape, np.float32) * np.float32(rng.uniform(0.005, 0.06))
    return image + (cv2.resize(noise, (width, height)) if coarse else noise)


def stickers(rng: Generator, image: Image) -> Image:
    """Small patches (labels, tape, dirt) that hide a little of what is behind them without changing what it is."""
    result = image.copy()
    height, width = image.shape[:2]
    for _ in range(int(rng.integers(1, 6))):
        w, h = int(rng.integers(3, 28)), int(rng.integers(3, 14))
        x, y = int(rng.integers(0, width - w)), int(rng.integers(0, height - h))
        result[y : y + h, x : x + w] = rng.uniform(0, 1, 3) + rng.normal(0, 0.1, (h, w, 3))
    return result


def dim(rng: Generator, image: Image) -> Image:
    """A sixth to a half of the light, and the noise of a camera that makes up for it."""
    dark = image * np.float32(rng.uniform(0.15, 0.5))
    return dark + rng.standard_normal(image.shape, np.float32) * np.float32(rng.uniform(0.01, 0.04))


def alike(rng: Generator, image: Image, mask: Bytes) -> Image:
    """Members take most of the colour of what is beside them: grey before grey, white on white."""
    share = ((mask > 0) & (mask != IGNORE)).astype(np.float32)[:, :, None]
    near = [cv2.blur(np.dstack([image * part, part]), (61, 61)) for part in (share, 1 - share)]
    (inside, outside) = (blurred[..., :3] / np.maximum(blurred[..., 3:], 0.02) for blurred in near)
    soft = cv2.blur(share, (3, 3))[:, :, None]
    return np.asarray(image + soft * (outside - inside) * np.float32(rng.uniform(0.5, 1.0)), np.float32)


def compressed(rng: Generator, image: Bytes) -> Bytes:
    """JPEG at a random quality."""
    quality = int(rng.integers(25, 96))
    _, encoded = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, quality])
    decoded = cv2.imdecode(encoded, cv2.IMREAD_COLOR)
    return np.asarray(decoded, np.uint8)


Change = Callable[[Generator, Image], Image]


@dataclass(frozen=True)
class Variation:
    """How likely each change of a picture is: of the colours of its classes and of the background, each on its own, of
    the whole, in this order, and JPEG."""

    recolour: float
    changes: tuple[tuple[float, Change], ...]
    jpeg: float
    alike: float = 0.0

    def chances(self) -> dict[str, float]:
        """By name."""
        return {
            "recolour": self.recolour,
            "jpeg": self.jpeg,
            "alike": self.alike,
            **{change.__name__: chance for chance, change in self.changes},
        }


ANY_PLACE, HARDER, ONE_SITE = "any place", "harder", "one site"
VARIATIONS = {
    ANY_PLACE: Variation(
        0.5,
        (
            (0.25, stickers),
            (0.5, uneven_lighting),
            (0.6, colour),
            (0.8, tone),
            (0.5, blurred),
            (0.2, sharpened),
            (0.6, noisy),
        ),
        0.6,
    ),
    HARDER: Variation(
        0.4,
        (
            (0.25, stickers),
            (0.5, uneven_lighting),
            (0.5, colour),
            (0.7, tone),
            (0.12, dim),
            (0.5, blurred),
            (0.2, sharpened),
            (0.5, noisy),
        ),
        0.5,
        0.15,
    ),
    ONE_SITE: Variation(
        0.1,
        (
            (0.15, stickers),
            (0.4, uneven_lighting),
            (0.2, colour),
            (0.6, tone),
            (0.4, blurred),
            (0.15, sharpened),
            (0.4, noisy),
        ),
        0.4,
    ),
}
"""What a network that is to be used anywhere is shown; the same with weak contrast and little light more often; and
what one is shown for a site that is painted alike throughout."""


def augment(
    rng: Generator, image: Bytes, mask: Bytes, crop: Crop, classes: int, variation: Variation = VARIATIONS[ANY_PLACE]
) -> tuple[Bytes, Bytes]:
    """A random variant: picture (height, width, 3) uint8 and mask (height, width) of the crop's size."""
    crop_from_image = random_homography(rng, crop, image.shape[1], image.shape[0])
    varied, labels = warp(image, mask, crop_from_image, crop, classes)
    if rng.random() < variation.recolour:
        varied = recolour(rng, varied, labels, classes)
    if rng.random() < variation.alike:
        varied = alike(rng, varied, labels)
    for chance, change in variation.changes:
        if rng.random() < chance:
            varied = change(rng, np.clip(varied, 0, 1))
    final = (np.clip(varied, 0, 1) * 255 + 0.5).astype(np.uint8)
    return (compressed(rng, final) if rng.random() < variation.jpeg else final), labels


Batch = tuple[NDArray[np.uint8], NDArray[np.uint8]]
"""Pictures (n, h, w, 3) and masks (n, h, w)."""


@dataclass(frozen=True, eq=False)
class BatchSource:
    """What is drawn from: samples with their probabilities (n,), the network's number of classes, sizes, seed, and how
    pictures are varied. A batch follows from the seed and its number; a run that goes on begins with number `start`."""

    samples: Sequence[Sample]
    weights: NDArray[np.float64]
    classes: int
    size: int
    seed: int
    crop: Crop = field(default_factory=Crop)
    start: int = 0
    variation: Variation = VARIATIONS[ANY_PLACE]

    def batch(self, number: int) -> Batch:
        """The batch of a number."""
        rng = np.random.default_rng([self.seed, number])
        variants = []
        for index in rng.choice(len(self.samples), self.size, p=self.weights):
            image, mask = self.samples[index].load()
            variants.append(augment(rng, image, mask, self.crop, self.classes, self.variation))
        return np.stack([image for image, _ in variants]), np.stack([mask for _, mask in variants])


def prefetched(source: BatchSource, threads: int = 1, ahead: int = 4) -> Iterator[Batch]:
    """The batches of `source` in order, without end; threads make some `ahead`. Their errors are raised here."""
    with ThreadPoolExecutor(threads) as pool:
        numbers = count(source.start)
        waiting = deque(pool.submit(source.batch, number) for number in islice(numbers, threads + ahead))
        try:
            for number in numbers:
                yield waiting.popleft().result()
                waiting.append(pool.submit(source.batch, number))
        finally:
            pool.shutdown(wait=False, cancel_futures=True)
