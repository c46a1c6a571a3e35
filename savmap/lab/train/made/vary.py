"""Random variation of whole batches of labelled pictures where torch computes, as `augment` does it one by one.

Beyond that, members that hardly differ from what is beside them, netting before everything, and gloom.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from savmap.lab.train.data.augment import OVEREXPOSED, Crop, random_homography
from savmap.lab.train.data.dataset import IGNORE

Change = Callable[[Tensor], Tensor]
GREY = (0.299, 0.587, 0.114)


def uniform(like: Tensor, low: float, high: float, *shape: int) -> Tensor:
    """Random numbers (n, *shape), one set for each picture."""
    return torch.rand((len(like), *shape), device=like.device) * (high - low) + low


def normal(like: Tensor, deviation: float, *shape: int) -> Tensor:
    """The same, normally distributed about 0."""
    return torch.randn((len(like), *shape), device=like.device) * deviation


def chosen(like: Tensor, chance: float) -> Tensor:
    """(n, 1, 1, 1) bool, true for some pictures."""
    return uniform(like, 0, 1, 1, 1, 1) < chance


def homographies(count: int, crop: Crop, width: int, height: int, rng: np.random.Generator) -> Tensor:
    """(n, 3, 3) from crop to picture pixels; see `augment.random_homography`."""
    matrices = np.stack([random_homography(rng, crop, width, height) for _ in range(count)])
    return torch.from_numpy(np.linalg.inv(matrices).astype(np.float32))


def warped(images: Tensor, masks: Tensor, picture_from_crop: Tensor, crop: Crop, classes: int) -> tuple[Tensor, Tensor]:
    """Crops: pictures (n, 3, h, w) 0..1 of (n, 3, H, W) uint8, and masks (n, h, w) int64, resampled class by class."""
    height, width = masks.shape[1:]
    device = images.device
    v, u = torch.meshgrid(
        torch.arange(crop.height, device=device, dtype=torch.float32),
        torch.arange(crop.width, device=device, dtype=torch.float32),
        indexing="ij",
    )
    places = torch.stack([u, v, torch.ones_like(u)], dim=-1).reshape(1, -1, 3) @ picture_from_crop.transpose(1, 2)
    places = places[..., :2] / places[..., 2:].clamp(min=1e-6)
    size = torch.tensor([width, height], device=device, dtype=torch.float32)
    grid = ((2 * places + 1) / size - 1).reshape(-1, crop.height, crop.width, 2)
    pictures = functional.grid_sample(images.float(), grid, padding_mode="reflection", align_corners=False)
    values = torch.tensor([*range(classes + 1), IGNORE], device=device)
    shares = (masks[:, None] == values[None, :, None, None]).float()
    winner = values[functional.grid_sample(shares, grid, align_corners=False).argmax(dim=1)]
    outside = (grid.abs() > 1).any(dim=-1)
    return pictures / 255, torch.where(outside, IGNORE, winner)


def box_mean(images: Tensor, size: int) -> Tensor:
    """Mean over squares of `size` px, an odd number; what lies outside does not count."""
    return functional.avg_pool2d(images, size, 1, size // 2, count_include_pad=False)


def soft(share: Tensor) -> Tensor:
    """A mask (n, 1, h, w) whose borders blend over a pixel, as a camera's do."""
    return box_mean(share.float(), 3)


def rotation(degrees: Tensor, saturation: Tensor) -> Tensor:
    """(n, 3, 3) that turn hues and change saturation."""
    angle = torch.deg2rad(degrees)
    c, s = torch.cos(angle), torch.sin(angle) / math.sqrt(3)
    grey = torch.full((3, 3), 1 / 3, device=degrees.device)
    cross = torch.tensor([[0.0, -1, 1], [1, 0, -1], [-1, 1, 0]], device=degrees.device)
    turn = (
        c[:, None, None] * torch.eye(3, device=degrees.device)
        + (1 - c)[:, None, None] * grey
        + s[:, None, None] * cross
    )
    return grey + saturation[:, None, None] * (turn - grey)


def turned(images: Tensor, matrices: Tensor) -> Tensor:
    """Pictures with their colours multiplied by (n, 3, 3)."""
    return torch.einsum("nij,njhw->nihw", matrices, images)


def brightness(images: Tensor) -> Tensor:
    """(n, 1, h, w)."""
    return sum(share * images[:, k : k + 1] for k, share in enumerate(GREY))


def recoloured(images: Tensor, masks: Tensor, classes: int) -> Tensor:
    """Some classes and the background repainted, each on its own; what shines keeps its look."""
    result = images
    for value in range(classes + 1):
        share = (masks == value)[:, None]
        inside = soft(share)
        count = share.sum(dim=(2, 3), keepdim=True).clamp(min=1)
        flat = (images * share).sum(dim=(2, 3), keepdim=True) / count
        hue = turned(images, rotation(uniform(images, -180, 180), uniform(images, 0.3, 1.6))) * uniform(
            images, 0.5, 1.5, 1, 1, 1
        )
        bright = brightness(images)
        colour = bright / brightness(flat).clamp(min=0.05) * uniform(images, 0.03, 0.95, 3, 1, 1)
        kind = uniform(images, 0, 1, 1, 1, 1)
        paint = torch.where(
            kind < 0.45, hue, torch.where(kind < 0.75, colour, images * uniform(images, 0.35, 1.9, 1, 1, 1))
        )
        shines = (flat.mean(dim=1, keepdim=True) > OVEREXPOSED) & (value > 0)
        apply = chosen(images, 0.6) & ~shines
        result = torch.where(apply, result * (1 - inside) + paint * inside, result)
    return result


def blended_in(images: Tensor, masks: Tensor) -> Tensor:
    """Members take the brightness and colour of what is beside them, all but for some of the difference: galvanised on
    grey, white on white."""
    share = ((masks > 0) & (masks != IGNORE))[:, None].float()
    half = functional.avg_pool2d(torch.cat([images * share, images * (1 - share), share], dim=1), 4)
    near = box_mean(half, 15)
    inside, outside = near[:, 6:], 1 - near[:, 6:]
    difference = near[:, 3:6] / outside.clamp(min=0.02) - near[:, :3] / inside.clamp(min=0.02)
    difference = functional.interpolate(difference, images.shape[2:], mode="bilinear", align_corners=False)
    return images + soft(share) * difference * uniform(images, 0.5, 1.0, 1, 1, 1)


def field(images: Tensor, cells: int) -> Tensor:
    """(n, 1, h, w), slowly varying, roughly normal."""
    return functional.interpolate(
        normal(images, 1.0, 1, cells, cells), images.shape[2:], mode="bicubic", align_corners=False
    )


def stickers(images: Tensor) -> Tensor:
    """Small patches that hide what is behind them without changing what it is."""
    height, width = images.shape[2:]
    rows = torch.arange(height, device=images.device)[None, None, :, None]
    columns = torch.arange(width, device=images.device)[None, None, None, :]
    for _ in range(4):
        x, y = uniform(images, 0, width, 1, 1, 1), uniform(images, 0, height, 1, 1, 1)
        w, h = uniform(images, 3, 28, 1, 1, 1), uniform(images, 3, 14, 1, 1, 1)
        inside = (rows >= y) & (rows < y + h) & (columns >= x) & (columns < x + w)
        images = torch.where(inside & chosen(images, 0.7), uniform(images, 0, 1, 3, 1, 1), images)
    return images


def netting(images: Tensor) -> Tensor:
    """Wires crossing before everything, at a period of 6 to 30 px, in a part of the picture."""
    height, width = images.shape[2:]
    v, u = torch.meshgrid(
        torch.arange(height, device=images.device), torch.arange(width, device=images.device), indexing="ij"
    )
    angle, period = uniform(images, -0.9, 0.9, 1, 1, 1), torch.exp(uniform(images, math.log(6), math.log(30), 1, 1, 1))
    squash, thick = uniform(images, 0.5, 1.0, 1, 1, 1), uniform(images, 0.6, 1.6, 1, 1, 1)
    a = u * torch.cos(angle) + v * torch.sin(angle)
    b = -u * torch.sin(angle) + v * torch.cos(angle)
    gap = torch.minimum((a % (period * squash) - thick).abs(), (b % period - thick).abs())
    wire = (1.2 + thick / 2 - gap).clamp(0, 1) * uniform(images, 0.3, 0.95, 1, 1, 1)
    part = (u > uniform(images, -0.5, 0.5, 1, 1, 1) * width) & (u < uniform(images, 0.6, 1.5, 1, 1, 1) * width)
    wire = wire * part
    return images * (1 - wire) + wire * uniform(images, 0.02, 0.9, 1, 1, 1) * uniform(images, 0.9, 1.1, 3, 1, 1)


def uneven(images: Tensor) -> Tensor:
    """Pools of light and shadow."""
    return images * torch.exp(field(images, int(np.random.randint(2, 6))) * uniform(images, 0.05, 0.45, 1, 1, 1))


def coloured(images: Tensor) -> Tensor:
    """Hue and saturation of the whole picture; now and then no colour."""
    wide = chosen(images, 0.4)[:, 0, 0, 0]
    degrees = torch.where(wide, uniform(images, -180, 180), normal(images, 25.0))
    saturation = torch.where(chosen(images, 0.12)[:, 0, 0, 0], 0.0, uniform(images, 0.4, 1.5))
    return turned(images, rotation(degrees, saturation))


def toned(images: Tensor) -> Tensor:
    """Exposure, white balance, contrast and gamma."""
    gains = torch.exp(normal(images, 0.25, 1, 1, 1) + normal(images, 0.1, 3, 1, 1))
    curved = (images * gains).clamp(0.0, 1.0).clamp(min=1e-4) ** torch.exp(normal(images, 0.25, 1, 1, 1))
    pivot = curved.mean(dim=(1, 2, 3), keepdim=True)
    return (curved - pivot) * torch.exp(normal(images, 0.2, 1, 1, 1)) + pivot + normal(images, 0.04, 1, 1, 1)


def gloomy(images: Tensor) -> Tensor:
    """A dark hall, or light from behind: members are nearly black."""
    return (images.clamp(0, 1) + 1e-4) ** uniform(images, 1.0, 1.5, 1, 1, 1) * uniform(images, 0.2, 0.7, 1, 1, 1)


def separable(images: Tensor, kernels: Tensor, across: bool) -> Tensor:
    """Each picture convolved with its own kernel (n, k) along rows or columns."""
    count, channels, height, width = images.shape
    size = kernels.shape[1]
    padding = (size // 2, size // 2, 0, 0) if across else (0, 0, size // 2, size // 2)
    padded = functional.pad(images, padding, mode="replicate").reshape(
        1, count * channels, *(-1, width) if not across else (height, -1)
    )
    weights = kernels.repeat_interleave(channels, dim=0)[:, None]
    weights = weights[:, :, None, :] if across else weights[:, :, :, None]
    return functional.conv2d(padded, weights, groups=count * channels).reshape(images.shape)


def gaussian(images: Tensor, sigma: Tensor) -> Tensor:
    """Each picture blurred by its own sigma (n,), px."""
    reach = torch.arange(-4, 5, device=images.device)
    kernels = torch.exp(-(reach[None] ** 2) / (2 * sigma[:, None] ** 2))
    kernels = kernels / kernels.sum(dim=1, keepdim=True)
    return separable(separable(images, kernels, True), kernels, False)


def blurred(images: Tensor) -> Tensor:
    """Defocus, sideways motion, or a lower resolution scaled up."""
    reach = torch.arange(-4, 5, device=images.device).abs()[None]
    motion = (reach <= torch.randint(1, 5, (len(images), 1), device=images.device)).float()
    moved = separable(images, motion / motion.sum(dim=1, keepdim=True), True)
    factor = float(np.random.uniform(0.5, 0.9))
    small = functional.interpolate(images, scale_factor=factor, mode="bilinear", align_corners=False)
    coarse = functional.interpolate(small, images.shape[2:], mode="bilinear", align_corners=False)
    kind = uniform(images, 0, 1, 1, 1, 1)
    defocused = gaussian(images, uniform(images, 0.3, 1.2))
    return torch.where(kind < 0.5, defocused, torch.where(kind < 0.75, moved, coarse))


def sharpened(images: Tensor) -> Tensor:
    """The halo that cameras add along edges."""
    return images + uniform(images, 0.2, 1.0, 1, 1, 1) * (images - gaussian(images, uniform(images, 1.0, 1.001)))


def noisy(images: Tensor) -> Tensor:
    """Sensor noise, coarse or fine."""
    height, width = images.shape[2:]
    coarse = functional.interpolate(normal(images, 1.0, 3, height // 2, width // 2), (height, width), mode="bilinear")
    noise = torch.where(chosen(images, 0.3), coarse, normal(images, 1.0, 3, height, width))
    return images + noise * uniform(images, 0.005, 0.06, 1, 1, 1)


def compressed(images: Tensor) -> Tensor:
    """Blocks of 8x8 px with their frequencies rounded, as JPEG does it."""
    k = torch.arange(8, device=images.device, dtype=torch.float32)
    cosines = (
        torch.cos((2 * k[None] + 1) * k[:, None] * math.pi / 16) * torch.where(k == 0, math.sqrt(1 / 8), 0.5)[:, None]
    )
    count, channels, height, width = images.shape
    bright = brightness(images)
    opponent = torch.cat([bright, images[:, ::2] - bright], dim=1)
    blocks = opponent.reshape(count, channels, height // 8, 8, width // 8, 8)
    steps = (1 + k[:, None, None] + k) * 3.0 / 255
    rough = torch.tensor([1.0, 1.8, 1.8], device=images.device)[:, None, None, None, None]
    steps = steps * rough * torch.exp(uniform(images, math.log(0.3), math.log(4.0), 1, 1, 1, 1, 1))
    rounded = torch.round(torch.einsum("ij,nchjwk,lk->nchiwl", cosines, blocks, cosines) / steps) * steps
    opponent = torch.einsum("ij,nchiwl,lk->nchjwk", cosines, rounded, cosines).reshape(images.shape)
    red, blue = opponent[:, 1:2] + opponent[:, :1], opponent[:, 2:] + opponent[:, :1]
    green = (opponent[:, :1] - GREY[0] * red - GREY[2] * blue) / GREY[1]
    return torch.cat([red, green, blue], dim=1)


@dataclass(frozen=True)
class Variety:
    """How likely each change is, in this order."""

    changes: tuple[tuple[float, Change], ...] = (
        (0.25, stickers),
        (0.08, netting),
        (0.5, uneven),
        (0.6, coloured),
        (0.8, toned),
        (0.1, gloomy),
        (0.5, blurred),
        (0.2, sharpened),
        (0.6, noisy),
    )
    recoloured: float = 0.5
    blended_in: float = 0.2
    jpeg: float = 0.5

    def chances(self) -> dict[str, float]:
        """By name."""
        return {
            "recoloured": self.recoloured,
            "blended in": self.blended_in,
            "jpeg": self.jpeg,
            **{c.__name__: chance for chance, c in self.changes},
        }


def some_of(images: Tensor, chance: float) -> Tensor:
    """Numbers of some pictures, (k,), drawn on the processor so that a device need not wait."""
    return torch.from_numpy(np.flatnonzero(np.random.random(len(images)) < chance)).to(images.device, non_blocking=True)


def applied(images: Tensor, chance: float, change: Callable[..., Tensor], *others: Tensor) -> Tensor:
    """The change, made to some of the pictures alone; `others` are further tensors of all pictures that it reads."""
    where = some_of(images, chance)
    if not len(where):
        return images
    result = images.clone()
    result[where] = change(images[where].clamp(0, 1), *(other[where] for other in others))
    return result


def varied(images: Tensor, masks: Tensor, classes: int, variety: Variety) -> Tensor:
    """Crops (n, 3, h, w) 0..1 with everything but their shapes changed -> 0..255, whole numbers."""
    images = applied(images, variety.recoloured, partial(recoloured, classes=classes), masks)
    images = applied(images, variety.blended_in, blended_in, masks)
    for chance, change in variety.changes:
        images = applied(images, chance, change)
    images = applied(images, variety.jpeg, compressed)
    return (images.clamp(0, 1) * 255).round()
