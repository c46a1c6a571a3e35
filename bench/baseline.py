"""Stored results in `baseline.json`, and what has become worse since: numbers only.

A result's figures are a table: row -> column -> number. Counts are compared exactly, other numbers with 2 % of slack, and only in columns for
which the bench says whether less or more is better. Processor time is printed and never compared: machines differ.
"""

import json
import os
import platform
import subprocess
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Literal

from savmap.files.atomic import write_text

FILE = Path(__file__).with_name("baseline.json")
SLACK = 0.02
Figures = Mapping[str, Mapping[str, float]]
Better = Mapping[str, Literal["less", "more"]]


@dataclass(frozen=True)
class Result:
    """What a bench measured: its settings as on the command line, when, at which revision and on what machine (in words)."""

    figures: Figures
    settings: str
    date: str
    revision: str = ""
    machine: str = ""


def read(file: Path = FILE) -> dict[str, Result]:
    """Stored results by name."""
    return {name: Result(**entry) for name, entry in json.loads(file.read_text(encoding="utf-8")).items()}


def store(name: str, result: Result, file: Path = FILE) -> None:
    """Replace one result."""
    write_text(file, text({**read(file), name: result}))


def text(results: Mapping[str, Result]) -> str:
    """The results as JSON, each row of figures on a line."""
    parts = []
    for name in sorted(results):
        entry = asdict(results[name])
        rows = entry.pop("figures").items()
        lines = ",\n".join(f"  {json.dumps(row)}: {json.dumps(cells)}" for row, cells in rows)
        parts.append(f' {json.dumps(name)}: {{{json.dumps(entry)[1:-1]}, "figures": {{\n{lines}\n }}}}')
    return "{\n" + ",\n".join(parts) + "\n}\n"


def result_of(figures: Figures, settings: str) -> Result:
    """A result measured here and now."""
    git = ["git", "-C", str(FILE.parent), "rev-parse", "--short=8", "HEAD"]
    revision = subprocess.run(git, capture_output=True, text=True, check=False).stdout.strip()
    machine = f"{os.cpu_count()} cores, {platform.machine()}"
    return Result(figures, settings, datetime.now(UTC).date().isoformat(), revision, machine)


def worse(now: Figures, before: Figures, better: Better) -> Iterator[str]:
    """A line for each figure that has become worse, and for each row or column that is missing now."""
    for row, cells in before.items():
        for column, old in cells.items():
            wanted = better.get(column)
            new = now.get(row, {}).get(column)
            if wanted is None:
                continue
            if new is None:
                yield f"{row}, {column}: {old:g} before, not measured now"
                continue
            slack = 0.0 if isinstance(old, int) else SLACK * abs(old)
            if (new - old if wanted == "less" else old - new) > slack:
                yield f"{row}, {column}: {old:g} before, {new:g} now"


def table(figures: Figures) -> str:
    """The figures as text for the terminal."""
    lines = cells_of(figures)
    widths = [max(len(line[k]) for line in lines) for k in range(len(lines[0]))]
    padded = (
        [line[0].ljust(widths[0]), *(c.rjust(w) for c, w in zip(line[1:], widths[1:], strict=True))] for line in lines
    )
    return "\n".join("  ".join(line) for line in padded)


def cells_of(figures: Figures) -> list[list[str]]:
    """A head and a line for each row, as text."""
    columns = list(dict.fromkeys(column for cells in figures.values() for column in cells))
    return [
        ["", *columns],
        *([row, *(_cell(cells.get(column)) for column in columns)] for row, cells in figures.items()),
    ]


def _cell(value: float | None) -> str:
    if value is None:
        return "-"
    return str(value) if isinstance(value, int) else f"{value:.3g}"
