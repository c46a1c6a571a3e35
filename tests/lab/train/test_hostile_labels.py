"""Labels with numbers beyond reason are one line."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from savmap.errors import OutputError
from savmap.lab.train.data.sets import read_set


@pytest.mark.parametrize("kind", ["rectangle", "polygon"])
@pytest.mark.parametrize("far", [1e300, -1e300, "1e999"])
def test_corners_beyond_reason_are_refused(tmp_path: Path, kind: str, far: float) -> None:
    cv2.imwrite(str(tmp_path / "a.png"), np.zeros((32, 64, 3), np.uint8))
    corners = [[1, 1], [20, far], [20, 20]][: 2 if kind == "rectangle" else 3]
    shapes = [{"label": name, "points": corners, "shape_type": kind} for name in ("post", "beam")]
    (tmp_path / "a.json").write_text(json.dumps({"imagePath": "a.png", "shapes": shapes}))
    with pytest.raises(
        OutputError, match=r"a.json: shapes\[0\]: a corner is (more than 1000000 pixels away|not a finite)"
    ):
        read_set(tmp_path, ["post", "beam"])
