"""One drawn recording that the tests of `savmap split` share."""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))

from drawn import Woven, aisles, recording, weaving

from savmap.apps.split.find import find


@pytest.fixture(scope="session")
def woven(tmp_path_factory: pytest.TempPathFactory) -> Woven:
    file, path = recording(tmp_path_factory.mktemp("woven"), aisles(3), weaving(3, stops=[(23.0, 5.0)]))
    return Woven(file, path, find(file))
