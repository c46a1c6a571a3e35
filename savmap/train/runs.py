"""Run-length masks of COCO: runs of background and object in turn, down the columns; as numbers, or packed into a string."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

_BITS, _MORE, _NEGATIVE = 0x1F, 0x20, 0x10
_FIRST_CHARACTER = 48


def unpacked(text: str) -> list[int]:
    """Runs from COCO's string: five bits a character, low ones first; from the fourth run on, differences to the one but last.

    Source: rleFrString in the COCO API (cocoapi, common/maskApi.c). Raises ValueError for a string that is none.
    """
    runs: list[int] = []
    value = shift = 0
    for code in (ord(character) - _FIRST_CHARACTER for character in text):
        if not 0 <= code < 2 * _MORE:
            raise ValueError("not a run-length string")
        value |= (code & _BITS) << shift
        shift += 5
        if code & _MORE:
            continue
        if code & _NEGATIVE:
            value -= 1 << shift
        runs.append(value + runs[-2] if len(runs) > 2 else value)
        value = shift = 0
    if shift:
        raise ValueError("a run-length string that breaks off")
    return runs


def mask_of(runs: Sequence[int], height: int, width: int) -> NDArray[np.bool_]:
    """(height, width) from runs down the columns, background first. Raises ValueError where they do not fill the picture."""
    if any(run < 0 for run in runs) or sum(runs) != height * width:
        raise ValueError(f"runs of {sum(runs)} pixels in a picture of {width}x{height}")
    values = np.arange(len(runs)) % 2 == 1
    return np.ascontiguousarray(np.repeat(values, runs).reshape(width, height).T)
