"""`savmap export map.json --format pallets -o pallets.csv`: a line a pallet."""

import csv
from pathlib import Path

from savmap.types import SiteMap

COLUMNS = ("x_m", "z_m", "turn_deg", "sigma_m", "sigma_turn_deg")


def write_pallets(site: SiteMap, path: Path) -> None:
    """Place, turn and standard deviations of every pallet, in its row's frame."""
    with path.open("w", newline="", encoding="utf-8") as file:
        table = csv.writer(file)
        table.writerow(("row", "pallet", *COLUMNS))
        for name, row in site.rows.items():
            for one in row.structures.get("pallets", ()):
                table.writerow((name, one.id, *(f"{float(one.attributes[key]):.4f}" for key in COLUMNS)))
