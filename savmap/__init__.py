"""savmap: metric, semantic wireframe maps of structured places from panoramic video.

    import savmap
    site_map = savmap.map_video("aisle.mp4", camera_height_m=3.05)
    site_map.to_dataframe()

What is named here is public: it stays as it is within a major version. It is imported when it is first used, so that
`import savmap` takes no time. docs/python-api.md shows it at work; plugin authors begin with `Plugin` and `hookimpl`,
and docs/writing-plugins.md.
"""

import os
from importlib import import_module
from typing import TYPE_CHECKING, Any

os.environ["ORT_DISABLE_TELEMETRY"] = "1"
"""onnxruntime 1.29 and later reports to its maker unless this is set before it is loaded. Here, for whatever opens a
network imports something of savmap first: workers and plugins too; and processes that they start inherit it."""

if TYPE_CHECKING:
    from savmap.errors import SavmapError
    from savmap.jobs.api import (
        align,
        compare,
        evaluate,
        export,
        find,
        import_survey,
        load_map,
        map_site,
        map_video,
        measure,
        view,
    )
    from savmap.maps.comparison import Comparison, Difference, ElementChange, RowComparison, RowMotion
    from savmap.maps.distance import VertexDistance
    from savmap.maps.map_file import write_map
    from savmap.maps.search import SearchHit
    from savmap.maps.survey import write_survey
    from savmap.plugin.hookspecs import hookimpl
    from savmap.plugin.protocol import Plugin
    from savmap.report.viewer.notebook import MapView
    from savmap.types import (
        CrossRowLandmark,
        Detection,
        Doubt,
        Evaluation,
        Feature,
        FrameTable,
        Panorama,
        Placement,
        ReferenceUse,
        RowFacts,
        RowMap,
        Score,
        SiteMap,
        Structure,
        Survey,
        Track,
        Trajectory,
        Verdict,
        View,
        ViewPlan,
        ViewSpec,
    )
    from savmap.types.progress import Monitor

__all__ = [
    "Comparison",
    "CrossRowLandmark",
    "Detection",
    "Difference",
    "Doubt",
    "ElementChange",
    "Evaluation",
    "Feature",
    "FrameTable",
    "MapView",
    "Monitor",
    "Panorama",
    "Placement",
    "Plugin",
    "ReferenceUse",
    "RowComparison",
    "RowFacts",
    "RowMap",
    "RowMotion",
    "SavmapError",
    "Score",
    "SearchHit",
    "SiteMap",
    "Structure",
    "Survey",
    "Track",
    "Trajectory",
    "Verdict",
    "VertexDistance",
    "View",
    "ViewPlan",
    "ViewSpec",
    "align",
    "compare",
    "evaluate",
    "export",
    "find",
    "hookimpl",
    "import_survey",
    "load_map",
    "map_site",
    "map_video",
    "measure",
    "view",
    "write_map",
    "write_survey",
]
_MODULES = {
    "SavmapError": "savmap.errors",
    "Monitor": "savmap.types.progress",
    "MapView": "savmap.report.viewer.notebook",
    "SearchHit": "savmap.maps.search",
    "VertexDistance": "savmap.maps.distance",
    "write_map": "savmap.maps.map_file",
    "write_survey": "savmap.maps.survey",
    "hookimpl": "savmap.plugin.hookspecs",
    "Plugin": "savmap.plugin.protocol",
    **dict.fromkeys(
        ("Comparison", "Difference", "ElementChange", "RowComparison", "RowMotion"), "savmap.maps.comparison"
    ),
    **dict.fromkeys(
        (
            "align",
            "compare",
            "evaluate",
            "export",
            "find",
            "import_survey",
            "load_map",
            "map_site",
            "map_video",
            "measure",
            "view",
        ),
        "savmap.jobs.api",
    ),
}


def __getattr__(name: str) -> Any:
    if name not in __all__:
        raise AttributeError(f"module 'savmap' has no attribute {name!r}")
    value = getattr(import_module(_MODULES.get(name, "savmap.types")), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
