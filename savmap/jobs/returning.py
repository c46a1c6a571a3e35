"""Passes of rows that an earlier map has: the map with what they showed, and what changed."""

from collections.abc import Mapping
from dataclasses import replace

from savmap.errors import StructureError
from savmap.jobs.scheduler import MappedRows
from savmap.maps.map_file import read_map
from savmap.plugin.apps import Changes, dates
from savmap.site.job import Job
from savmap.types import RowMap, SiteMap


def back_in_map(job: Job, mapped: MappedRows, made_by: Mapping[str, str]) -> tuple[MappedRows, SiteMap, Changes]:
    """What was mapped of a job's rows, by the names of the earlier map's rows, that map with it, and what changed.
    Raises StructureError where two of the job's rows are one row of the map, or where what was mapped does not fit."""
    assert job.against is not None
    names: dict[str, str] = {}
    passes: dict[str, RowMap] = {}
    for name, row in mapped.rows.items():
        if row.name in passes:
            other = next(given for given, taken in names.items() if taken == row.name)
            raise StructureError(
                f"rows {other} and {name} are both row {row.name} of {job.against}: "
                "give their videos as passes of one row"
            )
        names[name], passes[row.name] = row.name, row
    site_map, changes = dates().updated(read_map(job.against), passes, made_by)
    failed = {name: str(error) for name, error in mapped.failed.items() if name not in site_map.rows}
    log = mapped.log.model_copy(update={"rows": {names.get(name, name): run for name, run in mapped.log.rows.items()}})
    return (
        replace(
            mapped,
            rows=passes,
            log=log,
            orthophotos={names[name]: photo for name, photo in mapped.orthophotos.items()},
            stills={names[name]: stills for name, stills in mapped.stills.items()},
        ),
        replace(site_map, failed=failed),
        changes,
    )
