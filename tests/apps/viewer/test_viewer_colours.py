"""The viewer's colours as colour-blind people see them, on its light ground and on its dark one."""

import re
from itertools import combinations
from pathlib import Path
from typing import get_args

import cv2
import numpy as np
import pytest

from savmap.apps import viewer
from savmap.apps.dates.comparison.records import State
from savmap.types import Floats

SOURCE = (Path(viewer.__file__).with_name("source") / "scene" / "colours.js").read_text("utf-8")
THEMES = ("light", "dark")
PAIRS = [(theme, eye) for theme in THEMES for eye in ("none", "protan", "deutan", "tritan")]
FEW = 4
"""Labels that most maps have no more of."""


def theme_text(theme: str) -> str:
    return SOURCE.split(f"  {theme}: {{")[1].split("\n  },")[0]


def colours(theme: str, *names: str) -> dict[str, str]:
    """The codes of a theme's single colours, or of a table or list of them."""
    text = theme_text(theme)
    inner = [re.search(rf"{name}: [{{\[](.*?)[}}\]]", text, re.DOTALL) for name in names]
    if all(inner):
        listed = "".join(found[1] for found in inner if found)
        named = re.findall(r'"?(\b[\w ]+)"?: "(#\w{6})"', listed)
        return dict(named or enumerate(re.findall(r"#\w{6}", listed)))
    return {name: re.search(rf'{name}: "(#\w{{6}})"', text)[1] for name in names}  # type: ignore[index]


def linear(codes: dict[str, str]) -> Floats:
    """Linear sRGB (n, 3)."""
    srgb = np.array([[int(code[k : k + 2], 16) / 255 for k in (1, 3, 5)] for code in codes.values()])
    made: Floats = np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)
    return made


def as_seen(colours: Floats, deficiency: str) -> Floats:
    """Linear sRGB (n, 3) as people without one kind of cones see it (Machado et al. 2009), in CIELAB."""
    matrices = {
        "none": np.eye(3),
        "protan": [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]],
        "deutan": [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]],
        "tritan": [[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602], [0.004733, 0.691367, 0.303900]],
    }
    seen = np.clip(colours @ np.array(matrices[deficiency]).T, 0, 1).astype(np.float32)
    gamma = np.where(seen <= 0.0031308, 12.92 * seen, 1.055 * seen ** (1 / 2.4) - 0.055).astype(np.float32)
    lab: Floats = cv2.cvtColor(gamma[None], cv2.COLOR_RGB2LAB)[0].astype(np.float64)
    return lab


def least_apart(codes: dict[str, str], deficiency: str) -> float:
    lab = as_seen(linear(codes), deficiency)
    return min(float(np.linalg.norm(a - b)) for a, b in combinations(lab, 2))


@pytest.mark.parametrize(("theme", "deficiency"), PAIRS)
def test_states_are_told_apart_by_every_eye(theme: str, deficiency: str) -> None:
    states = colours(theme, "states")
    assert set(states) == set(get_args(State))
    assert least_apart(states, deficiency) > 20


@pytest.mark.parametrize(("theme", "deficiency"), PAIRS)
def test_verdicts_are_told_apart_by_every_eye(theme: str, deficiency: str) -> None:
    assert least_apart(colours(theme, "good", "check", "ofRow", "grey"), deficiency) > 20


@pytest.mark.parametrize(("theme", "deficiency"), PAIRS)
def test_common_labels_are_told_apart_by_every_eye(theme: str, deficiency: str) -> None:
    labels = dict(list(colours(theme, "labels").items())[:FEW])
    assert least_apart(labels, deficiency) > 15


@pytest.mark.parametrize("theme", THEMES)
def test_lines_stand_out_from_their_ground(theme: str) -> None:
    luminance = np.array([0.2126, 0.7152, 0.0722])
    (ground,) = linear(colours(theme, "ground")) @ luminance
    lists = linear(colours(theme, "labels")), linear(colours(theme, "ramp"))
    single = linear(colours(theme, "good", "check", "ofRow", "grey", "selected", "path"))
    lights = np.concatenate([*lists, single]) @ luminance
    contrast = (np.maximum(lights, ground) + 0.05) / (np.minimum(lights, ground) + 0.05)
    assert contrast.min() >= 3
