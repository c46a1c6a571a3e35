"""One text from many readings: each counts as much as its confidence; the sum decides, and says how sure the text is."""

import re
from collections import defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from savmap_signs.reading import TEXT

LEAST_READINGS = 2
DOUBTFUL = 0.5
DIGITS = 3
CORRECTED = ("QRCode:", "DataMatrix:", "Aztec:")
"""Codes that correct and check themselves: one reading is enough. Bar codes and tags are now and then read where there are none."""


@dataclass(frozen=True)
class Words:
    """A sign's text and how sure it is (0..1; "" and 0 where it is not known), and its code's kind and content, or ""."""

    text: str = ""
    confidence: float = 0.0
    code: str = ""


def voted(readings: Iterable[Mapping[str, float]], pattern: str | None, least_confidence: float) -> Words:
    """What most readings of a sign say. A text is believed if two readings or more agree on it, it matches the pattern, and it
    has the wanted share of what all readings of text weigh; a code if it was read twice, or, one that checks itself, once and never
    another."""
    texts: dict[str, list[float]] = defaultdict(list)
    codes: dict[str, int] = defaultdict(int)
    for reading in readings:
        for what, confidence in reading.items():
            kind, _, content = what.partition(":")
            if kind != TEXT:
                codes[what] += 1
            elif (text := _matching(content, pattern)) is not None:
                texts[text].append(max(confidence - DOUBTFUL, 0.0) / (1 - DOUBTFUL))
    text, confidence = _best(texts, least_confidence)
    return Words(text, confidence, _code(codes))


def _matching(text: str, pattern: str | None) -> str | None:
    """The text as the pattern has it, where spaces do not count; None where it does not match."""
    if pattern is None:
        return text
    candidates = (text, text.replace(" ", ""), *text.split())
    return next((one for one in candidates if re.fullmatch(pattern, one)), None)


def _best(texts: Mapping[str, list[float]], least_confidence: float) -> tuple[str, float]:
    if not texts:
        return "", 0.0
    weights = {text: sum(own) for text, own in texts.items()}
    text = min(weights, key=lambda one: (-weights[one], one))
    share = weights[text] / max(sum(weights.values()), 1e-9)
    confidence = round(share * weights[text] / len(texts[text]), DIGITS)
    if len(texts[text]) < LEAST_READINGS or confidence < least_confidence:
        return "", 0.0
    return text, confidence


def _code(codes: Mapping[str, int]) -> str:
    if not codes:
        return ""
    code = min(codes, key=lambda one: (-codes[one], one))
    sure = len(codes) == 1 and code.startswith(CORRECTED)
    return code if sure or codes[code] >= LEAST_READINGS else ""
