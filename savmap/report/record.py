"""What a site report is made from."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from savmap.evaluation import Evaluation
from savmap.report.drawing import Drawing
from savmap.types import SiteMap

if TYPE_CHECKING:
    from savmap.maps.run_record import RunLog


@dataclass(frozen=True)
class Report:
    """A map, what the plugins draw of each row, by name, and, where there are any, the run that made it, its scores against a
    survey, and remarks for the reader."""

    site_map: SiteMap
    drawings: Mapping[str, Sequence[Drawing]]
    log: "RunLog | None" = None
    evaluation: Evaluation | None = None
    remarks: tuple[str, ...] = ()
    title: str = "Site map"
