"""What is written on a sign: text by RapidOCR's networks, QR, Data Matrix and bar codes by ZXing, AprilTags by OpenCV.

A reading is "text:A21-03", "QRCode:..." or "tag36h11:7", with a confidence. Small prints are enlarged first.
"""

import importlib
import importlib.util
from collections.abc import Mapping
from functools import lru_cache
from typing import Any

import cv2
import numpy as np

from savmap.types import Floats, Panorama, ViewSpec
from savmap_signs.patches import Grey, patch_of, source_size

NEEDED = {"rapidocr": "rapidocr", "zxingcpp": "zxing-cpp"}
TEXT = "text"
TAGS = "tag36h11"
LEAST_HEIGHT_PX = 14.0
TALL_PX, WIDE_PX = 144, 640
LEAST_CONFIDENCE = 0.75
SURE = 1.0
ROUND = 4


def missing_packages() -> tuple[str, ...]:
    """The packages of the extra `signs` that are not installed."""
    return tuple(package for module, package in NEEDED.items() if importlib.util.find_spec(module) is None)


def advice() -> str | None:
    """A line for the user where nothing can be read; None where all is there."""
    missing = missing_packages()
    if not missing:
        return None
    return f"signs are mapped without their text: {', '.join(missing)} not installed; pip install 'savmap[signs]'"


def read(panorama: Panorama, spec: ViewSpec, corners: Floats) -> Mapping[str, float]:
    """What stands on the sign with these corners (4, 2) px of a view, with confidences 0..1; nothing where it is too small in
    the panorama, or the packages that read are missing."""
    size = source_size(corners, spec, panorama.height)
    if missing_packages() or min(size) < LEAST_HEIGHT_PX:
        return {}
    fineness = max(1.0, min(TALL_PX / size[1], WIDE_PX / size[0]))
    image = patch_of(panorama, spec, corners, size, 0.12, fineness).image
    return codes(image) | texts(image)


def codes(image: Grey) -> dict[str, float]:
    """Codes in a picture (h, w), grey."""
    zxing = importlib.import_module("zxingcpp")
    found = {f"{_name(one.format)}:{one.text}": SURE for one in zxing.read_barcodes(image) if one.valid and one.text}
    _, numbers, _ = _tags().detectMarkers(image)
    return found | {f"{TAGS}:{int(number)}": SURE for number in (numbers if numbers is not None else ())}


def texts(image: Grey) -> dict[str, float]:
    """The lines of text in a picture (h, w), grey, from the top down, as one text; its confidence is that of the least sure."""
    said = _engine()(cv2.cvtColor(image, cv2.COLOR_GRAY2RGB))
    if said.txts is None or said.boxes is None:
        return {}
    lines = [
        (float(box[:, 1].mean()), float(box[:, 0].mean()), text.strip(), float(score))
        for box, text, score in zip(np.asarray(said.boxes), said.txts, said.scores, strict=True)
        if score >= LEAST_CONFIDENCE and text.strip()
    ]
    if not lines:
        return {}
    whole = " ".join(text for _, _, text, _ in sorted(lines))
    return {f"{TEXT}:{whole}": round(min(score for *_, score in lines), ROUND)}


def _name(form: Any) -> str:
    return str(form).rpartition(".")[2].replace(" ", "")


@lru_cache(maxsize=1)
def _tags() -> cv2.aruco.ArucoDetector:
    return cv2.aruco.ArucoDetector(cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36H11))


@lru_cache(maxsize=1)
def _engine() -> Any:
    """RapidOCR with the networks in its wheel, one thread, the text's place looked for at the picture's own size."""
    settings = {
        "Global.use_cls": False,
        "Global.log_level": "critical",
        "EngineConfig.onnxruntime.intra_op_num_threads": 1,
        "EngineConfig.onnxruntime.inter_op_num_threads": 1,
        "Det.limit_type": "max",
        "Det.limit_side_len": 480,
    }
    return importlib.import_module("rapidocr").RapidOCR(params=settings)
