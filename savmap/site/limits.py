"""The limits of an inspection: a YAML file that a site may write, with a section for each plugin."""

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field

from savmap.files.validation import validated
from savmap.plugin.inspection import InspectionLimits
from savmap.site.load import read_draft, section_in

Metres = Annotated[float, Field(gt=0, lt=100)]


class EnvelopeLimits(InspectionLimits):
    """What must pass along every aisle, such as a truck with its load: an upright rectangle, swept along it."""

    width_m: Metres | None = None
    """Width of what must pass along the aisle."""
    height_m: Metres | None = None
    """Height of what must pass along the aisle."""
    margin_m: Annotated[float, Field(gt=0, lt=10)] = 0.1
    """What should be free around it: less is amber, nothing is red."""
    source: str = "the site"
    """Where these numbers come from."""


class SiteLimits(InspectionLimits):
    """The limits that a site sets instead of the usual ones."""

    envelope: EnvelopeLimits = EnvelopeLimits()
    """What must pass along the aisles."""
    plugins: Mapping[str, Mapping[str, Any]] = {}
    """By plugin: its limits."""


def load_limits(path: Path) -> SiteLimits:
    """The limits of a file. Raises SiteError with file and line; what a plugin does not take, it says itself."""
    return section_in(SiteLimits, read_draft(path, what="file of limits", guide="docs/inspection.md"))


def limits_of(given: Mapping[str, Any]) -> SiteLimits:
    """The same of a mapping. Raises SiteError."""
    return validated(SiteLimits, given, "limits")
