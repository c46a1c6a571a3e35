"""Printed surfaces: cartons, labels, bar codes, posters."""

import string

import cv2
import numpy as np

from savmap.lab.sim.paint.atlas import TILE, Texture
from savmap.lab.sim.paint.faces import Singles
from savmap.lab.sim.paint.materials import woven
from savmap.lab.sim.paint.noise import Random, clouds, field, rgb_of, streaks, texture
from savmap.lab.sim.paint.stage import Rgb

_FONTS = (cv2.FONT_HERSHEY_SIMPLEX, cv2.FONT_HERSHEY_DUPLEX, cv2.FONT_HERSHEY_TRIPLEX, cv2.FONT_HERSHEY_COMPLEX)


def vivid(rng: Random, least: float = 0.0, most: float = 1.0) -> Rgb:
    """Any colour, saturated between two bounds."""
    hue, saturation, value = rng.random() * 360, rng.uniform(least, most), rng.uniform(0.15, 0.95)
    pixel = np.array([[[hue, saturation, value]]], np.float32)
    red, green, blue = cv2.cvtColor(pixel, cv2.COLOR_HSV2RGB)[0, 0].tolist()
    return red, green, blue


def words(rng: Random) -> str:
    """Something that looks like a word or a number."""
    letters = string.ascii_uppercase if rng.random() < 0.7 else string.digits
    return "".join(rng.choice(list(letters), int(rng.integers(2, 9))))


def put_text(
    picture: Singles, text: str, at: tuple[int, int], font: int, scale: float, colour: Rgb, thick: int
) -> None:
    """Writes a text on a picture (h, w, 3) of floats: OpenCV writes on bytes alone."""
    ink = np.zeros(picture.shape[:2], np.uint8)
    cv2.putText(ink, text, at, font, scale, 255, thick, cv2.LINE_AA)
    picture[:] = picture + (ink.astype(np.float32) / 255)[..., None] * (np.asarray(colour, np.float32) - picture)


def write(picture: Singles, rng: Random, colour: Rgb, low: float = 0.3, high: float = 2.0) -> None:
    """Writes a word somewhere on a picture."""
    at = (int(rng.integers(-20, TILE - 40)), int(rng.integers(20, TILE)))
    scale = float(rng.uniform(low, high))
    thick = int(rng.integers(1, 2 + round(2 * scale)))
    put_text(picture, words(rng), at, int(rng.choice(_FONTS)), scale, colour, thick)


def bars(picture: Singles, rng: Random, box: tuple[int, int, int, int]) -> None:
    """Fills a part (left, top, width, height) of a picture with a bar code."""
    left, top, width, height = box
    code = rng.random(max(4, width // int(rng.integers(1, 4)))) < 0.5
    row = cv2.resize(code.astype(np.float32)[None], (width, height), interpolation=cv2.INTER_NEAREST)
    part = picture[top : top + height, left : left + width]
    part[:] = (1 - 0.92 * row[: part.shape[0], : part.shape[1], None]) * np.float32(0.95)


def label(rng: Random) -> Texture:
    """A paper label: text, a bar code, a coloured field."""
    paper: Rgb = (0.96, 0.96, 0.94) if rng.random() < 0.75 else vivid(rng, 0.5)
    picture = rgb_of(np.ones((TILE, TILE), np.float32), paper)
    if rng.random() < 0.7:
        bars(picture, rng, (20, int(rng.integers(10, 140)), 216, int(rng.integers(40, 110))))
    for _ in range(int(rng.integers(1, 5))):
        write(picture, rng, (0.1, 0.1, 0.12), 0.5, 2.5)
    return texture(picture, 0.0)


def strip(rng: Random) -> Texture:
    """A row of price tags in a holder."""
    picture = rgb_of(np.full((TILE, TILE), 0.85, np.float32), vivid(rng, 0.0, 0.4) if rng.random() < 0.5 else (1, 1, 1))
    for left in range(0, TILE, int(rng.integers(24, 70))):
        width = int(rng.integers(15, 50))
        colour = (0.95, 0.95, 0.92) if rng.random() < 0.7 else vivid(rng, 0.6)
        cv2.rectangle(picture, (left, 25), (left + width, TILE - 25), colour, -1)
        cv2.rectangle(picture, (left + 4, 60), (left + width - 6, 150), (0.2, 0.2, 0.2), 6)
    return texture(picture, 0.0)


def carton(rng: Random) -> Texture:
    """A carton's side: board, lid or tape, printed stripes and frames, words, marks, a label."""
    board = 0.8 + 0.08 * (clouds(rng, 2) - 0.5) + 0.04 * streaks(rng, 0.9, bool(rng.random() < 0.5))
    picture = rgb_of(board.astype(np.float32), _board_colour(rng))
    ink: Rgb = (0.15, 0.13, 0.13) if rng.random() < 0.5 else vivid(rng, 0.4)
    if rng.random() < 0.35:
        _bands(picture, rng, ink)
    if rng.random() < 0.25:
        cv2.rectangle(picture, (14, 14), (TILE - 14, TILE - 14), ink, int(rng.integers(1, 8)))
    for _ in range(int(rng.integers(0, 6))):
        write(picture, rng, ink)
    _closures(picture, rng)
    if rng.random() < 0.45:
        _sticker(picture, rng)
    edge = 1 - 0.25 * _border(int(rng.integers(2, 7)))
    return texture(picture * edge[..., None], float(rng.random() < 0.5))


def _board_colour(rng: Random) -> Rgb:
    kind = rng.random()
    if kind < 0.7:
        tone = rng.uniform(0.7, 1.05)
        return 0.93 * tone, (0.76 + 0.05 * rng.random()) * tone, (0.55 + 0.12 * rng.random()) * tone
    if kind < 0.85:
        return 1.15, 1.15, 1.12
    return vivid(rng, 0.0, 0.8)


def _bands(picture: Singles, rng: Random, ink: Rgb) -> None:
    """Printed level or upright stripes, like members in front."""
    for _ in range(int(rng.integers(1, 4))):
        at, thick = int(rng.integers(0, TILE)), int(rng.integers(4, 60))
        if rng.random() < 0.75:
            picture[at : at + thick] = ink
        else:
            picture[:, at : at + thick] = ink


def _closures(picture: Singles, rng: Random) -> None:
    """A lid's edge, a tape, a seam, a grip."""
    if rng.random() < 0.35:
        height = int(rng.integers(25, 90))
        picture[:height] *= float(rng.uniform(0.85, 1.15))
        picture[height : height + 5] *= 0.6
    if rng.random() < 0.5:
        at, wide = int(rng.integers(90, 150)), int(rng.integers(10, 28))
        colour = np.array((0.75, 0.62, 0.42) if rng.random() < 0.6 else (0.85, 0.85, 0.85), np.float32)
        part = picture[:, at : at + wide] if rng.random() < 0.5 else picture[at : at + wide]
        part[:] = 0.45 * part + 0.55 * colour
    if rng.random() < 0.3:
        picture[126:129] *= 0.6
    if rng.random() < 0.25:
        cv2.ellipse(picture, (TILE // 2, 70), (30, 9), 0, 0, 360, (0.08, 0.06, 0.05), -1, cv2.LINE_AA)


def _sticker(picture: Singles, rng: Random) -> None:
    left, top = int(rng.integers(10, 170)), int(rng.integers(10, 170))
    width, height = int(rng.integers(30, 80)), int(rng.integers(25, 75))
    cv2.rectangle(picture, (left, top), (left + width, top + height), (0.95, 0.95, 0.95), -1)
    bars(picture, rng, (left + 4, top + 4, width - 8, max(6, height // 2)))


def _border(width: int) -> Singles:
    border = np.zeros((TILE, TILE), np.float32)
    cv2.rectangle(border, (0, 0), (TILE - 1, TILE - 1), 1.0, width)
    return np.asarray(cv2.GaussianBlur(border, (0, 0), 2), np.float32)


def crate(rng: Random) -> Texture:
    """A plastic box's side: a rim, ribs, a grip, now and then a label; takes a tint."""
    grey = 0.78 + 0.1 * (clouds(rng, 2) - 0.5)
    rim = int(rng.integers(14, 60))
    grey[:rim] *= float(rng.uniform(1.0, 1.25))
    grey[rim : rim + 5] *= 0.55
    for at in range(int(rng.integers(5, 40)), TILE, int(rng.integers(22, 90))):
        grey[rim:, at : at + int(rng.integers(3, 9))] *= 0.8
    for at in rng.integers(rim, TILE, int(rng.integers(0, 4))):
        grey[at : at + 8] *= 1.15
    picture = rgb_of(grey.astype(np.float32))
    if rng.random() < 0.6:
        cv2.rectangle(picture, (96, rim + 12), (160, rim + 36), (0.15, 0.15, 0.15), -1)
    share = np.ones((TILE, TILE), np.float32)
    if rng.random() < 0.4:
        left, top = int(rng.integers(10, 150)), int(rng.integers(rim, 180))
        cv2.rectangle(picture, (left, top), (left + 70, top + 50), (0.95, 0.95, 0.93), -1)
        bars(picture, rng, (left + 5, top + 5, 60, 25))
        share[top : top + 50, left : left + 70] = 0
    return texture(picture, share)


def barrel(rng: Random) -> Texture:
    """A drum's or bucket's side, once around: hoops, lid, a label; takes a tint."""
    grey = 0.85 + 0.06 * (clouds(rng, 2) - 0.5)
    for at in (0, int(rng.integers(60, 100)), int(rng.integers(140, 190)), TILE - 14):
        grey[at : at + 6] *= 1.15
        grey[at + 6 : at + 14] *= 0.72
    picture, share = rgb_of(grey.astype(np.float32)), np.ones((TILE, TILE), np.float32)
    if rng.random() < 0.6:
        left, top, wide = int(rng.integers(20, 120)), int(rng.integers(60, 110)), int(rng.integers(40, 110))
        colour = (0.95, 0.95, 0.92) if rng.random() < 0.6 else vivid(rng, 0.3)
        cv2.rectangle(picture, (left, top), (left + wide, top + 90), colour, -1)
        put_text(picture, words(rng), (left + 4, top + 40), cv2.FONT_HERSHEY_DUPLEX, 0.8, (0.1, 0.1, 0.3), 2)
        share[top : top + 90, left : left + wide] = 0
    return texture(picture, share)


def sack(rng: Random) -> Texture:
    """A sack's side with print."""
    cloth: Singles = woven(rng)[..., :3].astype(np.float32) / np.float32(255)
    ink: Rgb = vivid(rng, 0.3)
    printed = np.ones((TILE, TILE, 3), np.float32)
    for _ in range(int(rng.integers(0, 4))):
        write(printed, rng, ink, 0.6, 2.0)
    if rng.random() < 0.4:
        _bands(printed, rng, ink)
    return texture(cloth * printed, 1.0)


def poster(rng: Random) -> Texture:
    """A board with text lines on any ground."""
    picture = rgb_of(0.9 + 0.05 * field(rng, 3, 3), vivid(rng, 0.0))
    ink = vivid(rng, 0.0)
    if rng.random() < 0.5:
        cv2.rectangle(picture, (8, 8), (TILE - 8, TILE - 8), ink, int(rng.integers(2, 14)))
    for top in range(int(rng.integers(20, 80)), TILE, int(rng.integers(25, 80))):
        scale = float(rng.uniform(0.4, 1.8))
        text = " ".join(words(rng) for _ in range(3))
        put_text(picture, text, (15, top), int(rng.choice(_FONTS)), scale, ink, 2)
    return texture(picture, 0.0)
