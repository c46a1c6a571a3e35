"""`python -m savmap`: the command, where no script is on the path."""

from savmap.cli import main

if __name__ == "__main__":
    main()
