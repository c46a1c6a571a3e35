"""The browser and the made-up maps of the report's tests."""

from ..report.conftest import chromium as chromium
from ..report.conftest import opened as opened
