"""Checkpoints: averaged weights with the classes they are for and how they came about."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import torch

from savmap.errors import OutputError
from savmap.train.network import SegmentationNetwork, build

Recipe = Mapping[str, object]
"""How one run of training went, as JSON holds it."""


def save_checkpoint(
    path: Path, network: SegmentationNetwork, classes: Sequence[str], history: Sequence[Recipe]
) -> None:
    """Averaged weights, class names and the recipes so far; written whole or not at all."""
    partial = path.with_name(path.name + ".partial")
    partial.parent.mkdir(parents=True, exist_ok=True)
    torch.save({"network": network.state_dict(), "classes": list(classes), "history": list(history)}, partial)
    partial.replace(path)


def load_checkpoint(path: Path, classes: Sequence[str]) -> tuple[SegmentationNetwork, list[Recipe]]:
    """Network and history of a checkpoint of the same classes. Raises OutputError."""
    try:
        content = torch.load(path, map_location="cpu", weights_only=True)
        network = build(len(classes), None)
        if content["classes"] != list(classes):
            raise OutputError(f"{path}: was trained for {', '.join(content['classes'])}, not {', '.join(classes)}")
        network.load_state_dict(content["network"])
    except (OSError, RuntimeError, KeyError, TypeError, EOFError) as error:
        raise OutputError(f"{path}: not a checkpoint of `savmap train`; start without it") from error
    return network, list(content["history"])
