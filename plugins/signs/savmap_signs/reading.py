"""What is written on a sign: read in each view, and one text and code voted from all readings.

Text is read by RapidOCR's networks, QR, Data Matrix and bar codes by ZXing, AprilTags by OpenCV. A reading is
"text:A21-03", "QRCode:..." or "tag36h11:7", with a confidence 0..1.
"""

import importlib
import importlib.util
import re
from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any

import cv2
import numpy as np

from savmap.types import Floats, Panorama, ViewSpec
from savmap_signs.features import Grey, rectify, size_in_panorama

PACKAGES = {"rapidocr": "rapidocr", "zxingcpp": "zxing-cpp"}
TEXT, APRIL_TAG = "text", "tag36h11"

# Reading in one view
LEAST_SIZE_PX = 14.0  # of the sign's shorter side, in the panorama
TALL_PX, WIDE_PX = 144, 640  # a small sign is enlarged until it has this height or width
MARGIN_SHARE = 0.12  # of the sign's shorter side
LEAST_LINE_CONFIDENCE = 0.75
CODE_CONFIDENCE = 1.0

# Voting
LEAST_READINGS = 2
NO_WEIGHT_CONFIDENCE = 0.5  # a text read with less than this does not count
SELF_CHECKING = ("QRCode:", "DataMatrix:", "Aztec:")
"""Codes that correct and check themselves: one reading is enough. Bar codes and tags are now and then read where there
are none."""


def missing_packages() -> tuple[str, ...]:
    """The packages of the extra `signs` that are not installed."""
    return tuple(package for module, package in PACKAGES.items() if importlib.util.find_spec(module) is None)


def missing_packages_note() -> str | None:
    """A line for the user if nothing can be read; None if all packages are installed."""
    missing = missing_packages()
    if not missing:
        return None
    return f"signs are mapped without their text: {', '.join(missing)} not installed; pip install 'savmap[signs]'"


def read(panorama: Panorama, spec: ViewSpec, corners: Floats) -> Mapping[str, float]:
    """Readings, with their confidences, of the sign with these corners (4, 2) px of a view.

    Empty if the sign is too small in the panorama, or if a package of the extra `signs` is missing. Small signs are
    enlarged.
    """
    size = size_in_panorama(corners, spec, panorama.height)
    if missing_packages() or min(size) < LEAST_SIZE_PX:
        return {}
    scale = max(1.0, min(TALL_PX / size[1], WIDE_PX / size[0]))
    image = rectify(panorama, spec, corners, size, MARGIN_SHARE, scale).image
    return read_codes(image) | read_text(image)


def read_codes(image: Grey) -> dict[str, float]:
    """Readings of the codes in a grey picture (h, w)."""
    barcodes = importlib.import_module("zxingcpp").read_barcodes(image)
    names = [
        f"{str(barcode.format).rpartition('.')[2].replace(' ', '')}:{barcode.text}"
        for barcode in barcodes
        if barcode.valid and barcode.text
    ]
    _, tags, _ = _tag_detector().detectMarkers(image)
    names += [f"{APRIL_TAG}:{int(number)}" for number in (tags if tags is not None else ())]
    return dict.fromkeys(names, CODE_CONFIDENCE)


def read_text(image: Grey) -> dict[str, float]:
    """The lines of text in a grey picture (h, w), from the top down, as one reading with the confidence of the least
    sure line."""
    result = _text_reader()(cv2.cvtColor(image, cv2.COLOR_GRAY2RGB))
    if result.txts is None or result.boxes is None:
        return {}
    lines = [
        (float(box[:, 1].mean()), float(box[:, 0].mean()), text.strip(), float(score))
        for box, text, score in zip(np.asarray(result.boxes), result.txts, result.scores, strict=True)
        if score >= LEAST_LINE_CONFIDENCE and text.strip()
    ]
    if not lines:
        return {}
    text = " ".join(text for _, _, text, _ in sorted(lines))
    return {f"{TEXT}:{text}": round(min(score for *_, score in lines), 4)}


@cache
def _tag_detector() -> cv2.aruco.ArucoDetector:
    return cv2.aruco.ArucoDetector(cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36H11))


@cache
def _text_reader() -> Any:
    """RapidOCR with the networks in its wheel, in one thread; it detects text at the picture's own size."""
    settings = {
        "Global.use_cls": False,
        "Global.log_level": "critical",
        "EngineConfig.onnxruntime.intra_op_num_threads": 1,
        "EngineConfig.onnxruntime.inter_op_num_threads": 1,
        "Det.limit_type": "max",
        "Det.limit_side_len": 480,
    }
    return importlib.import_module("rapidocr").RapidOCR(params=settings)


@dataclass(frozen=True)
class Inscription:
    """A sign's text with its confidence 0..1 ("" and 0 if it is not known), and its code's kind and content ("" if
    none)."""

    text: str = ""
    confidence: float = 0.0
    code: str = ""


def vote(readings: Iterable[Mapping[str, float]], pattern: str | None, least_confidence: float) -> Inscription:
    """The text and the code that most readings of a sign give. Each text weighs as much as its confidence exceeds 0.5.

    A text is taken if at least two readings agree on it, it matches the pattern, and its share of all weights, times
    its mean weight, reaches `least_confidence`. A code is taken if it was read twice; one that checks itself also if it
    was read once and no other code was.
    """
    weights: dict[str, list[float]] = defaultdict(list)
    codes: Counter[str] = Counter()
    for name, confidence in (item for reading in readings for item in reading.items()):
        kind, _, content = name.partition(":")
        if kind != TEXT:
            codes[name] += 1
        elif (text := _matching_text(content, pattern)) is not None:
            weights[text].append(max(confidence - NO_WEIGHT_CONFIDENCE, 0.0) / (1 - NO_WEIGHT_CONFIDENCE))
    return Inscription(*_heaviest_text(weights, least_confidence), _most_read_code(codes))


def _matching_text(text: str, pattern: str | None) -> str | None:
    """The part of a text that the pattern matches: the whole, the whole without spaces, or a word."""
    if pattern is None:
        return text
    candidates = (text, text.replace(" ", ""), *text.split())
    return next((candidate for candidate in candidates if re.fullmatch(pattern, candidate)), None)


def _heaviest_text(weights: Mapping[str, list[float]], least_confidence: float) -> tuple[str, float]:
    """The text of most weight and its confidence; "" and 0 if it is not sure enough."""
    if not weights:
        return "", 0.0
    totals = {text: sum(values) for text, values in weights.items()}
    text = min(totals, key=lambda candidate: (-totals[candidate], candidate))
    share = totals[text] / max(sum(totals.values()), 1e-9)
    confidence = round(share * totals[text] / len(weights[text]), 3)
    if len(weights[text]) < LEAST_READINGS or confidence < least_confidence:
        return "", 0.0
    return text, confidence


def _most_read_code(codes: Mapping[str, int]) -> str:
    if not codes:
        return ""
    code = min(codes, key=lambda candidate: (-codes[candidate], candidate))
    sure = len(codes) == 1 and code.startswith(SELF_CHECKING)
    return code if sure or codes[code] >= LEAST_READINGS else ""
