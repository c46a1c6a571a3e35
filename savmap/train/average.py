"""The mean of several checkpoints' weights: often better on pictures of another look than each of them.

    python -m savmap.train.average BEFORE.checkpoint.pt AFTER.checkpoint.pt --classes upright,beam -o model.onnx

Runs that go on from one another, with a learning rate that falls and starts anew, end in neighbouring minima, and their mean
lies in a flatter place than either (Izmailov et al., Averaging Weights Leads to Wider Optima, 2018).
"""

import argparse
from collections.abc import Mapping, Sequence
from pathlib import Path

import torch

from savmap.errors import ending_in_one_line
from savmap.train.checkpoint import load_checkpoint, save_checkpoint
from savmap.train.export import export


def average(checkpoints: Sequence[Path], classes: Sequence[str], output: Path) -> Mapping[str, object]:
    """Write the mean network (ONNX, and a checkpoint beside it); returns its recipe. The history is that of the last
    checkpoint. Raises OutputError for a file that is not a checkpoint of a network for these classes, in this order."""
    loaded = [load_checkpoint(path, classes, same=True) for path in checkpoints]
    states = [network.state_dict() for network, _ in loaded]
    network, history = loaded[-1]
    network.load_state_dict(
        {
            name: torch.stack([state[name] for state in states]).mean(dim=0) if last.is_floating_point() else last
            for name, last in states[-1].items()
        }
    )
    recipe = {"mean of checkpoints": [path.name for path in checkpoints]}
    save_checkpoint(output.with_suffix(".checkpoint.pt"), network, classes, [*history, recipe])
    whole = recipe | {"earlier": history}
    export(network, classes, whole, output)
    return whole


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("checkpoints", nargs="+", type=Path)
    parser.add_argument("--classes", required=True, help="comma-separated, in the order of the masks' numbers")
    parser.add_argument("-o", "--output", type=Path, default=Path("model.onnx"))
    given = parser.parse_args()
    with ending_in_one_line():
        average(given.checkpoints, given.classes.split(","), given.output)


if __name__ == "__main__":
    main()
