"""A simulated row with pallets, mapped with shelves and pallets in one run, and its errors.

    python bench.py [--scene row.yaml] [--keep DIR]

Footage already in DIR is used again. It takes some minutes, most of them for simulating.
"""

import argparse
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from savmap.jobs import run
from savmap.jobs.scheduler import RunOptions
from savmap.maps.map_file import read_map
from savmap.maps.survey import read_survey
from savmap.sim.scene.files import load_scene
from savmap.sim.simulate import simulate
from savmap.site.job import job_for
from savmap_pallets.evaluate import Match, matches
from savmap_pallets.survey import read_row

HEAD = "pallet          x m     z m  turn deg   sigma cm   sigma deg   off cm   off deg"


def table(map_file: Path, survey_file: Path) -> Iterator[str]:
    """Each row's pallets beside the survey's."""
    surveyed = read_survey(survey_file).rows
    for name, row in read_map(map_file).rows.items():
        truth, pallets = read_row(surveyed[name]).pallets, row.structures.get("pallets", ())
        found = matches(pallets, truth)
        by_id = {match.mapped.id: match for match in found}
        yield HEAD
        for one in pallets:
            x, z, turn, sigma, sigma_turn = (
                float(one.attributes[key]) for key in ("x_m", "z_m", "turn_deg", "sigma_m", "sigma_turn_deg")
            )
            match = by_id.get(one.id)
            off = f"{100 * match.distance_m:9.2f}{match.turn_deg:10.2f}" if match else f"{'-':>9}{'-':>10}"
            yield f"{one.id:12}{x:8.3f}{z:8.3f}{turn:10.2f}{100 * sigma:11.2f}{sigma_turn:12.2f}{off}"
        yield summary(found, len(truth), len(pallets))


def summary(found: Sequence[Match], true: int, mapped: int) -> str:
    """Counts, and mean and largest errors."""
    if not found:
        return f"0 of {true} found, {mapped} spurious"
    away, turn = np.array([match.distance_m for match in found]), np.abs([match.turn_deg for match in found])
    return (
        f"{len(found)} of {true} found, {mapped - len(found)} spurious; place: mean {100 * away.mean():.2f} cm, largest "
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
        list(run.run(job_for(folder / "site.yaml", ["shelves", "pallets"], folder / "out"), RunOptions(fresh=True)))
        print(run.scores_table(run.evaluate_files(folder / "out" / "map.json", folder / "survey.json")))
        print("\n".join(table(folder / "out" / "map.json", folder / "survey.json")))


if __name__ == "__main__":
    main()
