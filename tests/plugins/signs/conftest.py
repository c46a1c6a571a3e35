"""The tracks of a simulated pass, for tests of what comes after tracking."""

import pytest

from savmap.types import Track
from savmap_signs.settings import Settings
from savmap_signs.tracking import track_signs

from .aisle_pass import TRUTH, drive, sign_features

FACTS, PATH = drive()


@pytest.fixture(scope="package")
def tracks() -> list[Track]:
    return track_signs(sign_features(PATH, TRUTH), FACTS, PATH, Settings())
