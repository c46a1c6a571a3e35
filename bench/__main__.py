"""`python -m bench`: the index; `python -m bench NAME ...`: one bench; `python -m bench write-docs`: the pages made of stored results."""

import argparse
import importlib
import json
import shlex
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from bench import accuracy_doc, baseline
from bench.index import BENCHES, README, index, readme
from savmap.errors import ending_in_one_line
from savmap.files.atomic import write_text

PATHS = ("--keep", "--output", "-o", "--photos", "--cache")
"""Options that say where files are, and change no figure."""


def main(arguments: Sequence[str]) -> int:
    """Exit code: 0; 1 where a figure is worse than the stored one, or where the bench says so; 2 for an unknown name."""
    name, *rest = arguments or [""]
    if name in ("", "-h", "--help"):
        print(__doc__, index(baseline.read()), sep="\n\n")
        return 0
    if name == "write-docs":
        write_text(README, readme())
        write_text(accuracy_doc.PAGE, accuracy_doc.page(baseline.read()))
        return 0
    if name not in BENCHES:
        print(f"no bench is called {name}; python -m bench prints all", file=sys.stderr)
        return 2
    return measured(name, rest)


def measured(name: str, arguments: Sequence[str]) -> int:
    """Run a bench, print its figures, compare them with the stored ones or store them."""
    module = importlib.import_module(f"bench.{name.replace('-', '_')}")
    parser = argparse.ArgumentParser(
        f"python -m bench {name}",
        description=module.__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        conflict_handler="resolve",
    )
    parser.add_argument("--keep", type=Path, help="a folder for all files that it makes, which a later run uses again")
    parser.add_argument("--store", action="store_true", help="keep the figures as those to compare with")
    parser.add_argument("-o", "--output", type=Path, help="also write the figures to this JSON file")
    module.add_arguments(parser)
    given = parser.parse_args(arguments)
    with ending_in_one_line(), tempfile.TemporaryDirectory() as temporary:
        given.keep = given.keep or Path(temporary)
        given.keep.mkdir(parents=True, exist_ok=True)
        figures: baseline.Figures = module.run(given)
    if not figures:
        return 0
    print(baseline.table(figures))
    if given.output is not None:
        write_text(given.output, json.dumps(figures, indent=1) + "\n")
    result = baseline.result_of(figures, settings_of(arguments))
    key = f"{name}, {result.settings}" if result.settings else name
    if given.store:
        baseline.store(key, result)
        return 0
    before = baseline.read().get(key)
    lines = list(baseline.worse(figures, before.figures, BENCHES[name].better)) if before else []
    print(*(f"WORSE: {line}" for line in lines), sep="\n", end="\n" if lines else "")
    return int(bool(lines))


def settings_of(arguments: Sequence[str]) -> str:
    """The arguments that change figures; of files their names."""
    kept, skip = list[str](), False
    for argument in arguments:
        if skip or argument == "--store":
            skip = False
        elif argument.split("=")[0] in PATHS:
            skip = "=" not in argument
        else:
            kept.append(Path(argument).name if "/" in argument else argument)
    return shlex.join(kept)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
