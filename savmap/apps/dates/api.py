"""`savmap.compare`."""

from savmap.apps.dates.comparison.compare import LEVEL
from savmap.apps.dates.comparison.records import Comparison
from savmap.apps.dates.files import compared
from savmap.jobs.api import PathLike, map_of
from savmap.types import SiteMap


def compare(old: SiteMap | PathLike, new: SiteMap | PathLike, level: float = LEVEL) -> Comparison:
    """What changed from an old map of a place to a new one (records, or paths of map.json or of its folder), and what
    of it both can tell.

    Rows are known by their names; how their frames lie is found from what both maps have. level: the share of false
    ones among the changes that is accepted. Raises OutputError for a file that is no map, PluginError for a plugin that
    fails.
    """
    return compared(map_of(old), map_of(new), level)
