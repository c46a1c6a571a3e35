"""Slots of made-up rows: is it right which hold goods, how many are left unknown, and how wide and high is what is free?

    python -m bench slots [--set dev] [--count 4] [--family rows "grey rows" "dark rows"] [--keep DIR] [--fit FILE]

Rows are those of `rows`, both sides of the drive, mapped from footage; what is in their slots is read from the pictures
that the run keeps, as `savmap inspect` does it. "right %": of the slots that are not unknown. `--fit` counts and fits the
parameters on these rows and writes them; the shipped ones come from `--set train`.
"""

import argparse
import json
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

import savmap
from bench.baseline import Figures
from bench.rows import sites
from bench.seeds import SETS, is_test
from savmap.errors import SavmapError
from savmap.jobs.depths import kept_depths
from savmap.lab.sim.scene.build import build
from savmap.lab.sim.scene.files import load_scene
from savmap.types import FaceDepths, RowMap
from savmap_shelves.inspection.occupancy import Occupancy, fitted, occupancy_of
from savmap_shelves.lab.slots import Example, TrueSlot, example_of, fit, true_slots
from savmap_shelves.report.slots import places

FAMILIES = ("rows", "grey rows", "dark rows")
PER_CENT, CM = 100.0, 100.0


@dataclass(frozen=True, eq=False)
class SlotRow:
    """A mapped row, how deep behind its face lies what is seen, and its true slots."""

    family: str
    seed: int
    depths: FaceDepths
    slots: Sequence[TrueSlot]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of this bench."""
    parser.add_argument("--set", choices=SETS, default="dev", help="of seeds; `test` is printed as totals only")
    parser.add_argument("--count", type=int, default=4, help="of rows of each family")
    parser.add_argument("--family", choices=FAMILIES, nargs="+", default=FAMILIES)
    parser.add_argument("--frames", type=int, default=40)
    parser.add_argument("--fit", type=Path, metavar="FILE", help="fit the parameters and write them")
    parser.set_defaults(row="both", references="all")


def run(given: argparse.Namespace) -> Figures:
    """Figures over all slots; a line for each wrong or unknown one of `dev` and `train`."""
    rows = slot_rows(given, given.keep)
    if given.fit:
        return fitted_to(list(rows), given)
    pairs = [(row, slot, occupancy) for row in rows for slot, occupancy in read(row)]
    return {"total": totals([(slot, occupancy) for _, slot, occupancy in pairs])} if pairs else {}


def slot_rows(given: argparse.Namespace, base: Path) -> Iterator[SlotRow]:
    """The rows that are mapped, each as often as it has a side."""
    for family, seed, site, output in sites(given, base):
        try:
            row = mapped(site, output)
        except SavmapError as error:
            print(f"{family} {seed}: {'' if is_test(family, seed) else error} not mapped", flush=True)
            continue
        depths = kept_depths(output, row)
        if depths is not None:
            goods = build(load_scene(site.with_name("scene.yaml"))).goods[row.name]
            slots = true_slots(places(row.structures["shelves"], "shelves", row.joint), goods)
            yield SlotRow(family, seed, depths, slots)


def mapped(site: Path, output: Path) -> RowMap:
    """The only row of a site; what an earlier run left in the folder is kept. Raises SavmapError."""
    if not list(output.glob("face-*.jpg")):
        savmap.map_site(site, ["shelves"], output=output)
    (row,) = savmap.load_map(output / "map.json").rows.values()
    return row


def read(row: SlotRow) -> Iterator[tuple[TrueSlot, Occupancy]]:
    """What the model says of each slot; a line of each that it does not say rightly, where the row may be looked at."""
    for slot in row.slots:
        occupancy = occupancy_of(slot.slot, row.depths, fitted())
        if occupancy is not None:
            yield slot, occupancy
            if not is_test(row.family, row.seed) and occupancy.state != state(slot):
                print(
                    f"{row.family} {row.seed} {slot.slot.id}: {state(slot)}, called {occupancy.state} with {occupancy.probability:.2f}",
                    flush=True,
                )


def state(slot: TrueSlot) -> str:
    """The truth, in the words of the model."""
    return "occupied" if slot.is_occupied else "empty"


def totals(pairs: Sequence[tuple[TrueSlot, Occupancy]]) -> dict[str, float]:
    """The figures of all slots."""
    decided = [(slot, occupancy) for slot, occupancy in pairs if occupancy.state != "unknown"]
    right = [(slot, occupancy) for slot, occupancy in decided if occupancy.state == state(slot)]
    full = [(slot, occupancy) for slot, occupancy in right if slot.is_occupied]
    widths = [o.free_width.value - slot.free_width_m for slot, o in full if o.free_width]
    heights = [
        o.free_height.value - (float(o.slot.attributes["clear_height_m"]) - slot.top_m)
        for slot, o in full
        if o.free_height
    ]
    over = [(occupancy.over_edge > 0.5, slot.is_over_edge) for slot, occupancy in full]
    return {
        "slots": len(pairs),
        "occupied": sum(slot.is_occupied for slot, _ in pairs),
        "right %": PER_CENT * len(right) / max(len(decided), 1),
        "unknown %": PER_CENT * (1 - len(decided) / len(pairs)),
        "width cm": CM * float(np.median(np.abs(widths))) if widths else 0.0,
        "height cm": CM * float(np.median(np.abs(heights))) if heights else 0.0,
        "over edge": sum(true for _, true in over),
        "named": sum(said and true for said, true in over),
        "named wrongly": sum(said and not true for said, true in over),
    }


def fitted_to(rows: Sequence[SlotRow], given: argparse.Namespace) -> Figures:
    """Fit the parameters and write them, with their provenance."""
    shown: list[Example | None] = [example_of(slot, row.depths) for row in rows for slot in row.slots]
    examples = [example for example in shown if example is not None]
    parameters = fit(examples)
    values = {key: np.round(value, 4).tolist() for key, value in asdict(parameters).items()}
    said = f"python -m bench slots --fit, {len(examples)} slots of {len(rows)} rows, {given.set}: {', '.join(given.family)}"
    given.fit.write_text(json.dumps({"provenance": said, "parameters": values}, indent=1) + "\n", encoding="utf-8")
    return {"fit": {"slots": len(examples), "rows": len(rows)}}
