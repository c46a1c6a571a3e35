"""`savmap pallets MAP [--survey FILE]`: the pallets of a map as a table."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np

from savmap.types import Structure
from savmap_pallets.evaluate import Match, matches
from savmap_pallets.survey import read_row

if TYPE_CHECKING:
    import typer

HEAD = "pallet          x m     z m  turn deg   sigma cm   sigma deg   off cm   off deg"


def add_command(app: "typer.Typer") -> None:
    """Let `savmap` know the command."""
    import typer

    @app.command()
    def pallets(
        map_file: Annotated[Path, typer.Argument(metavar="MAP", help="A map.json of `savmap map`.")],
        survey: Annotated[Path | None, typer.Option(help="A survey file to compare with.")] = None,
    ) -> None:
        """List the pallets of a map, with their errors where a survey is given."""
        for line in lines(map_file, survey):
            typer.echo(line)


def lines(map_file: Path, survey: Path | None) -> Iterator[str]:
    """The table, row by row of the map. Raises OutputError for files that cannot be read."""
    from savmap.io.mapfile import read_map
    from savmap.io.survey import read_survey

    surveyed = read_survey(survey).rows if survey else {}
    for name, row in read_map(map_file).rows.items():
        own = row.structures.get("pallets", ())
        truth = read_row(surveyed[name]).pallets if "pallets" in surveyed.get(name, {}) else []
        found = matches(own, truth)
        yield f"row {name}"
        yield from table(own, found)
        if truth:
            yield summary(found, len(truth), len(own))


def table(pallets: Sequence[Structure], found: Sequence[Match]) -> Iterator[str]:
    """A line a pallet."""
    by_id = {match.mapped.id: match for match in found}
    yield HEAD
    for one in pallets:
        at = {key: float(one.attributes[key]) for key in ("x_m", "z_m", "turn_deg", "sigma_m", "sigma_turn_deg")}
        match = by_id.get(one.id)
        off = f"{100 * match.distance_m:9.2f}{match.turn_deg:10.2f}" if match else f"{'-':>9}{'-':>10}"
        yield (
            f"{one.id:12}{at['x_m']:8.3f}{at['z_m']:8.3f}{at['turn_deg']:10.2f}"
            f"{100 * at['sigma_m']:11.2f}{at['sigma_turn_deg']:12.2f}{off}"
        )


def summary(found: Sequence[Match], true: int, mapped: int) -> str:
    """Counts and mean errors."""
    if not found:
        return f"0 of {true} found, {mapped} spurious"
    distance, turn = np.array([m.distance_m for m in found]), np.abs([m.turn_deg for m in found])
    return (
        f"{len(found)} of {true} found, {mapped - len(found)} spurious; place: mean {100 * distance.mean():.2f} cm, largest "
        f"{100 * distance.max():.2f} cm; turn: mean {turn.mean():.2f} degrees, largest {turn.max():.2f} degrees"
    )
