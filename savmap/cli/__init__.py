"""The command line. `savmap --help` imports nothing that takes long."""

import sys


def main() -> None:
    """Run the command line."""
    if sys.argv[1:] == ["--help"]:
        from savmap.cli.commands import help_text

        print(help_text())
    else:
        from savmap.cli.app import main as run

        run()
