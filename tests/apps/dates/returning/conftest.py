"""Lets the tests here import the made-up place of the tests of comparisons."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "comparison"))
