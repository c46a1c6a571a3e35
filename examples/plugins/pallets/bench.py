"""A simulated row with pallets, mapped with shelves and pallets in one run, and its errors.

    python bench.py [--scene row.yaml] [--keep DIR]

Footage already in DIR is used again. It takes some minutes, most of them for simulating.
"""

import argparse
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

import savmap
from savmap.lab.sim.scene.files import load_scene
from savmap.lab.sim.simulate import simulate
from savmap.maps.survey import read_survey
from savmap.report.evaluation import as_table
from savmap.types import SiteMap
from savmap_pallets.evaluate import Match, matches
from savmap_pallets.survey import read_row

HEAD = "pallet          x m     z m  turn deg   sigma cm   sigma deg   off cm   off deg"


def table(site_map: SiteMap, survey_file: Path) -> Iterator[str]:
    """Each row's pallets beside the survey's."""
    surveyed = read_survey(survey_file).rows
    for name, row in site_map.rows.items():
        truth, pallets = read_row(surveyed[name]).pallets, row.structures.get("pallets", ())
        matched = matches(pallets, truth)
        by_id = {match.mapped.id: match for match in matched}
        yield HEAD
        for pallet in pallets:
            x, z, turn, sigma, sigma_turn = (
                float(pallet.attributes[key]) for key in ("x_m", "z_m", "turn_deg", "sigma_m", "sigma_turn_deg")
            )
            match = by_id.get(pallet.id)
            off = f"{100 * match.distance_m:9.2f}{match.turn_deg:10.2f}" if match else f"{'-':>9}{'-':>10}"
            yield f"{pallet.id:12}{x:8.3f}{z:8.3f}{turn:10.2f}{100 * sigma:11.2f}{sigma_turn:12.2f}{off}"
        yield summary(matched, len(truth), len(pallets))


def summary(matched: Sequence[Match], true: int, mapped: int) -> str:
    """Counts, and mean and largest errors."""
    if not matched:
        return f"0 of {true} found, {mapped} spurious"
    away, turn = np.array([match.distance_m for match in matched]), np.abs([match.turn_deg for match in matched])
    return (
        f"{len(matched)} of {true} found, {mapped - len(matched)} spurious; place: mean {100 * away.mean():.2f} cm, largest "
        f"{100 * away.max():.2f} cm; turn: mean {turn.mean():.2f} degrees, largest {turn.max():.2f} degrees"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scene", type=Path, default=Path(__file__).with_name("row.yaml"))
    parser.add_argument("--keep", type=Path, help="keep footage and map in this folder")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        folder = (given.keep or Path(scratch)) / given.scene.stem
        if not (folder / "site.yaml").is_file():
            simulate(load_scene(given.scene), folder)
        site_map = savmap.map_site(folder / "site.yaml", ["shelves", "pallets"], output=folder / "out")
        print(as_table(savmap.evaluate(site_map, folder / "survey.json")))
        print("\n".join(table(site_map, folder / "survey.json")))


if __name__ == "__main__":
    main()
