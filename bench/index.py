"""What each bench answers, in how many minutes on two cores, and which of its columns shall be small or large."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from bench.baseline import Better, Result, read

README = Path(__file__).with_name("README.md")
ERRORS: Better = {"missing": "less", "spurious": "less", "mean cm": "less", "largest cm": "less"}


@dataclass(frozen=True)
class Bench:
    """The question that a bench answers, minutes of processor time with its default settings, and which columns are compared."""

    question: str
    minutes: int
    better: Better = field(default_factory=dict)


BENCHES: Mapping[str, Bench] = {
    "rows": Bench(
        "Are made-up rows mapped whole from footage, and to how many centimetres?",
        60,
        {**ERRORS, "whole": "more", "trusted": "more", "refused": "less", "lamps cm": "less"},
    ),
    "fit": Bench("(a tool) The parameters of the face's model, by maximum likelihood on train rows", 60),
    "sigmas": Bench("Are the standard deviations of maps of footage true, class by class?", 30, {"error mm": "less"}),
    "site46": Bench(
        "Is a site of 46 rows whole and square, and do time and memory stay the same from row to row?",
        40,
        {**ERRORS, "across an aisle x m": "less", "along a rack's faces m": "less"},
    ),
    "compare": Bench(
        "Which changes between two dates are found, and how many are invented?",
        25,
        {"found": "more", "false": "less"},
    ),
    "against": Bench(
        "Is another pass along a mapped row laid into the right place, and what changed found?",
        15,
        {"wrong": "less", "right": "more", "found %": "more", "false %": "less", "after mm": "less"},
    ),
    "physics": Bench(
        "Do wrong references, clips and cameras (cuts, turns, other files) ever end as a trusted map?",
        240,
        {"silently wrong": "less", "false alarm": "less", "other reason": "less"},
    ),
    "photos": Bench(
        "What does a network see on labelled photographs of real racks?",
        6,
        {"IoU": "more", "found %": "more", "wrong %": "less"},
    ),
    "photo-rows": Bench(
        "Are rows mapped whose face is a real photograph?",
        45,
        {"good": "more", "wrong without a warning": "less", "missing": "less", "spurious": "less"},
    ),
    "photo-tiles": Bench("(a tool) Labelled photographs as pictures for training", 2),
    "live": Bench("How far does a live session stay behind, what does it say, and what memory does it take?", 10),
    "slots": Bench(
        "Is it right which slots of made-up rows hold goods, and how many are left unknown?",
        40,
        {"right %": "more", "unknown %": "less", "width cm": "less", "height cm": "less"},
    ),
    "signs": Bench(
        "How many legible signs are found and read, and is any text made up?",
        30,
        {"found": "more", "read": "more", "invented": "less", "spurious": "less", "mean cm": "less"},
    ),
    "split": Bench(
        "Does `savmap split` find the passes of a long recording?", 10, {"missed": "less", "spurious": "less"}
    ),
    "odometry": Bench(
        "Are paths of visual odometry true in their shape, and what do they cost, beside pycolmap's?",
        10,
        {"good %": "more", "median %": "less", "95 of 100 %": "less", "worst %": "less", "lost": "less"},
    ),
    "real": Bench(
        "(needs clips) Are real racks mapped from a phone's walk: equal bays, every post and beam, at what cost?",
        3,
        {"posts": "more", "beams": "more", "spread %": "less", "inner %": "less", "refused": "less"},
    ),
    "adapt": Bench(
        "Does `savmap adapt` teach a network a style without labels?",
        400,
        {"IoU": "more", "missing": "less", "spurious": "less"},
    ),
    "dark-pictures": Bench("(a tool) Labelled pictures of dark, thin racks for fine-tuning", 2),
    "cost": Bench("What do `savmap map` and each stage of it cost, beside decoding alone?", 20),
    "viewer": Bench("Does the viewer of a large site open and turn quickly?", 2, {"MB": "less"}),
    "inspection": Bench(
        "Are uprights and beams that are out of shape named, no others, and are standard deviations true?",
        15,
        {"named %": "more", "falsely named %": "less", "refused": "less"},
    ),
    "exports": Bench("What do all formats cost, and do validators find fault with them?", 3, {"faults": "less"}),
}


def index(results: Mapping[str, Result]) -> str:
    """A table of all benches with their last result, in Markdown."""
    lines = ["| command | question | minutes | last result | date |", "| --- | --- | --- | --- | --- |"]
    for name, bench in BENCHES.items():
        stored = [(key, result) for key, result in results.items() if key.split(", ")[0] == name]
        last = "; ".join(_last(key, result, bench.better) for key, result in stored) or "-"
        date = max((result.date for _, result in stored), default="-")
        lines.append(f"| `{name}` | {bench.question} | {bench.minutes} | {last} | {date} |")
    return "\n".join(lines)


def _last(key: str, result: Result, better: Better) -> str:
    """The compared figures of a result's last row, which is its total."""
    row, cells = list(result.figures.items())[-1]
    shown = {column: value for column, value in cells.items() if column in better} or cells
    text = ", ".join(f"{column} {value:.3g}" for column, value in list(shown.items())[:5])
    return f"{key.partition(', ')[2] or row}: {text}"


def readme() -> str:
    """The text of bench/README.md."""
    return f"""# Benches

`python -m bench NAME --help` says what a bench does and takes; `python -m bench` prints this table. Minutes are processor time on two cores.
`--store` writes the figures to [baseline.json](baseline.json); a later run with the same settings prints what has become worse and ends with 1.
[docs/accuracy.md](../docs/accuracy.md) is made of these figures (`python -m bench write-docs`, which writes this page, too).

Seeds come in three sets ([seeds.py](seeds.py)): parameters are fitted on `train`, rows of `dev` may be looked at, `test` is printed as totals only.

{index(read())}
"""
