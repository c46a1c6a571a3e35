"""Footage of a four-section aisle with its site file and survey, so that `savmap demo` runs wherever savmap is
installed."""

from pathlib import Path

SITE = Path(__file__).parent / "site.yaml"
