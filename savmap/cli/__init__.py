"""The command line. `savmap --help` imports nothing that takes long."""

import os
import sys


def main() -> None:
    """Run the command line. Python processes that it starts run no module of the working folder."""
    os.environ["PYTHONSAFEPATH"] = "1"
    if sys.argv[1:] == ["--help"]:
        from savmap.cli.commands import help_text

        print(help_text())
    else:
        from savmap.cli.app import main as run

        run()
