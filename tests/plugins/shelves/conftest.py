"""Lets the tests here import the helpers beside them."""

import sys
from pathlib import Path

FOLDER = Path(__file__).parent
sys.path[:0] = [str(FOLDER), str(FOLDER / "boundaries"), str(FOLDER / "tracking")]
