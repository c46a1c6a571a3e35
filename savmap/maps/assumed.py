"""Which coordinates of a map nothing measured: a plugin takes them to be so, such as where a post ends that goods
hide."""

from savmap.types import Bools, RowMap, Structure


def assumed_coordinates(row: RowMap, plugin: str, structure: Structure) -> Bools:
    """For each vertex and axis (v, 3) of a structure of the row whether it is an assumption."""
    return structure.assumed(plugin, row.joint)
