"""Train a plugin's network on, on pictures that are made meanwhile, until the process is killed:

    python -m savmap.lab.train.made shelves --init plugins/shelves/savmap_shelves/model/shelves.onnx
    python -m savmap.lab.train.made --resume
    python -m savmap.lab.train.made --decay

It runs niced, in one thread, beside a process that makes pictures. All it needs to go on lies in the folder `training`:
a checkpoint every ten minutes, pictures, and `train.log` with a line a minute. Data sets in its folder `data` are
trained on too. `--decay` lets the rate fall from the last checkpoint over the last fifth of all steps, then writes
`decayed.onnx` and `decayed.int8.onnx`; the checkpoint stays, for `--resume`.
"""

import argparse
from pathlib import Path

from savmap.errors import ending_in_one_line
from savmap.lab.train import check_extra


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("plugin", nargs="?", help="whose network; with --init")
    how = parser.add_mutually_exclusive_group(required=True)
    how.add_argument("--init", type=Path, help="begin with this float32 network")
    how.add_argument("--resume", action="store_true", help="go on from the checkpoint")
    how.add_argument("--decay", type=float, nargs="?", const=0.2, metavar="SHARE", help="of all steps; default: 0.2")
    parser.add_argument("-o", "--output", type=Path, default=Path("training"), help="the folder; default: training")
    given = parser.parse_args()
    if (given.init is None) != (given.plugin is None):
        parser.error("a plugin's name and --init go together")
    if given.decay is not None and not 0 < given.decay < 1:
        parser.error("--decay is a share, above 0 and below 1")
    if given.init is not None and (given.output / "checkpoint.pt").exists():
        parser.error(f"{given.output} has a checkpoint: --resume goes on with it; or choose another -o")
    with ending_in_one_line():
        check_extra()
        from savmap.lab.train.made.run import run  # torch, an extra, is imported when it is needed

        run(given.output, given.plugin, given.init, given.decay)


if __name__ == "__main__":
    main()
