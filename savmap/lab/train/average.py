"""The mean of the weights of several checkpoints, or of float32 networks: often better on pictures of another look than
each of them.

    python -m savmap.lab.train.average BEFORE.checkpoint.pt AFTER.checkpoint.pt --classes upright,beam [--weights 1 2]
    -o model.onnx

Runs that go on from one another, with a learning rate that falls and starts anew, end in neighbouring minima, and their
mean lies in a flatter place than either (Izmailov et al., Averaging Weights Leads to Wider Optima, 2018). The mean of a
network and of what it became on other pictures keeps what both see (Wortsman et al., Robust Fine-Tuning of Zero-Shot
Models, 2022).
"""

import argparse
from collections.abc import Mapping, Sequence
from pathlib import Path

import torch

from savmap.errors import OutputError, ending_in_one_line
from savmap.lab.train.checkpoint import load_checkpoint, save_checkpoint
from savmap.lab.train.export import export, load_onnx


def average(
    checkpoints: Sequence[Path],
    classes: Sequence[str],
    output: Path,
    weights: Sequence[float] = (),
) -> Mapping[str, object]:
    """Write the mean network (ONNX, and a checkpoint beside it); returns its recipe. `weights`: how much each file
    counts for, all alike without.

    All files are checkpoints, or all are ONNX files of `savmap train`, in which normalisations are folded. The history
    is that of the last. Raises OutputError for a file that is not a checkpoint of a network for these classes, in this
    order, and for weights that are not one for each file, all above 0; ModelError for an ONNX file that is none of
    ours.
    """
    if weights and (len(weights) != len(checkpoints) or min(weights) <= 0):
        raise OutputError(f"--weights: give one above 0 for each of the {len(checkpoints)} files")
    loaded = [
        load_onnx(path, classes) if path.suffix == ".onnx" else load_checkpoint(path, classes, same=True)
        for path in checkpoints
    ]
    states = [network.state_dict() for network, _ in loaded]
    shares = torch.tensor(weights or [1.0] * len(states), dtype=torch.float32)
    shares /= shares.sum()
    network, history = loaded[-1]
    network.load_state_dict(
        {
            name: torch.stack([share * state[name] for share, state in zip(shares, states, strict=True)]).sum(dim=0)
            if last.is_floating_point()
            else last
            for name, last in states[-1].items()
        }
    )
    recipe: dict[str, object] = {"mean of checkpoints": [path.name for path in checkpoints]}
    if weights:
        recipe["weights"] = [*weights]
    save_checkpoint(output.with_suffix(".checkpoint.pt"), network, classes, [*history, recipe])
    whole = recipe | {"earlier": history}
    export(network, classes, whole, output)
    return whole


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("checkpoints", nargs="+", type=Path)
    parser.add_argument("--classes", required=True, help="comma-separated, in the order of the masks' numbers")
    parser.add_argument("--weights", type=float, nargs="+", default=[], help="how much each counts for")
    parser.add_argument("-o", "--output", type=Path, default=Path("model.onnx"))
    given = parser.parse_args()
    with ending_in_one_line():
        average(given.checkpoints, given.classes.split(","), given.output, given.weights)


if __name__ == "__main__":
    main()
