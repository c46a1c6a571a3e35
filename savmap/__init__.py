"""savmap: metric, semantic wireframe maps of structured places from panoramic video.

    import savmap
    site_map = savmap.map_video("aisle.mp4", camera_height_m=3.05)
    site_map.to_dataframe()

What is named here is public: it stays as it is within a major version. It is imported when it is first used, so that
`import savmap` takes no time. docs/python-api.md shows it at work; plugin authors begin with `Plugin` and `hookimpl`,
and docs/writing-plugins.md.
"""

import os
import sys

if sys.argv[:1] == ["-m"] and "-m savmap" in " ".join(sys.orig_argv) and not sys.flags.safe_path:
    del sys.path[0]  # `python -m` puts the working folder there, whose `copy.py` would be taken for Python's own
    os.environ["PYTHONSAFEPATH"] = "1"

from importlib import import_module
from typing import TYPE_CHECKING, Any

os.environ["ORT_DISABLE_TELEMETRY"] = "1"
"""onnxruntime 1.29 and later reports to its maker unless this is set before it is loaded. Here, for whatever opens a
network imports something of savmap first: workers and plugins too; and processes that they start inherit it."""

if TYPE_CHECKING:
    from savmap.apps.dates.api import compare as compare
    from savmap.apps.dates.comparison.records import Comparison as Comparison
    from savmap.apps.dates.comparison.records import Difference as Difference
    from savmap.apps.dates.comparison.records import ElementChange as ElementChange
    from savmap.apps.dates.comparison.records import RowComparison as RowComparison
    from savmap.apps.dates.comparison.records import RowMotion as RowMotion
    from savmap.apps.exchange.api import import_survey as import_survey
    from savmap.apps.inspection.api import inspect as inspect
    from savmap.apps.live.api import LiveSession as LiveSession
    from savmap.apps.viewer.api import view as view
    from savmap.apps.viewer.notebook import MapView as MapView
    from savmap.errors import SavmapError as SavmapError
    from savmap.jobs.api import align as align
    from savmap.jobs.api import evaluate as evaluate
    from savmap.jobs.api import export as export
    from savmap.jobs.api import find as find
    from savmap.jobs.api import load_map as load_map
    from savmap.jobs.api import map_site as map_site
    from savmap.jobs.api import map_video as map_video
    from savmap.jobs.api import measure as measure
    from savmap.maps.distance import VertexDistance as VertexDistance
    from savmap.maps.map_file import write_map as write_map
    from savmap.maps.search import SearchHit as SearchHit
    from savmap.maps.survey import write_survey as write_survey
    from savmap.plugin.hookspecs import hookimpl as hookimpl
    from savmap.plugin.protocol import Plugin as Plugin
    from savmap.types import CrossRowLandmark as CrossRowLandmark
    from savmap.types import Detection as Detection
    from savmap.types import Evaluation as Evaluation
    from savmap.types import Feature as Feature
    from savmap.types import Finding as Finding
    from savmap.types import FrameTable as FrameTable
    from savmap.types import Inspection as Inspection
    from savmap.types import MapWarning as MapWarning
    from savmap.types import Panorama as Panorama
    from savmap.types import Placement as Placement
    from savmap.types import ReferenceUse as ReferenceUse
    from savmap.types import RowFacts as RowFacts
    from savmap.types import RowMap as RowMap
    from savmap.types import Score as Score
    from savmap.types import SiteMap as SiteMap
    from savmap.types import Structure as Structure
    from savmap.types import Survey as Survey
    from savmap.types import Track as Track
    from savmap.types import Trajectory as Trajectory
    from savmap.types import Verdict as Verdict
    from savmap.types import View as View
    from savmap.types import ViewPlan as ViewPlan
    from savmap.types import ViewSpec as ViewSpec
    from savmap.types.progress import Monitor as Monitor

_NAMES = {
    "savmap.apps.dates.api": "compare",
    "savmap.apps.dates.comparison.records": "Comparison Difference ElementChange RowComparison RowMotion",
    "savmap.apps.exchange.api": "import_survey",
    "savmap.apps.inspection.api": "inspect",
    "savmap.apps.live.api": "LiveSession",
    "savmap.apps.viewer.api": "view",
    "savmap.apps.viewer.notebook": "MapView",
    "savmap.errors": "SavmapError",
    "savmap.jobs.api": ("align evaluate export find load_map map_site map_video measure"),
    "savmap.maps.distance": "VertexDistance",
    "savmap.maps.map_file": "write_map",
    "savmap.maps.search": "SearchHit",
    "savmap.maps.survey": "write_survey",
    "savmap.plugin.hookspecs": "hookimpl",
    "savmap.plugin.protocol": "Plugin",
    "savmap.types": (
        "CrossRowLandmark Detection MapWarning Evaluation Feature Finding FrameTable Inspection Panorama Placement "
        "ReferenceUse RowFacts RowMap Score SiteMap Structure Survey Track Trajectory Verdict View ViewPlan ViewSpec"
    ),
    "savmap.types.progress": "Monitor",
}
"""What is public, by the module that it is imported from."""
_MODULES = {name: module for module, names in _NAMES.items() for name in names.split()}
__all__ = sorted(_MODULES)


def __getattr__(name: str) -> Any:
    if name not in _MODULES:
        raise AttributeError(f"module 'savmap' has no attribute {name!r}")
    value = getattr(import_module(_MODULES[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
