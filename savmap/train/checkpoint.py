"""Checkpoints: averaged weights with the classes they are for and how they came about."""

import io
import json
import pickle
from collections.abc import Mapping, Sequence
from pathlib import Path

import torch

from savmap.errors import OutputError
from savmap.files.atomic import write_bytes
from savmap.train.network import SegmentationNetwork, build

LAST_LAYER = "finish.logits."
"""Prefix of the weights that depend on the classes."""

BROKEN = (OSError, RuntimeError, LookupError, TypeError, ValueError, EOFError, pickle.UnpicklingError)
"""What reading a file that torch did not write, or not this way, raises."""

Recipe = Mapping[str, object]
"""How one run of training went, as JSON holds it."""


def save_checkpoint(
    path: Path, network: SegmentationNetwork, classes: Sequence[str], history: Sequence[Recipe]
) -> None:
    """Averaged weights, class names and the recipes so far; written whole or not at all. Raises OutputError."""
    content = io.BytesIO()
    torch.save(
        {"network": network.state_dict(), "classes": list(classes), "history": json.dumps(list(history))}, content
    )
    write_bytes(path, content.getvalue())


def load_checkpoint(path: Path, classes: Sequence[str], same: bool = False) -> tuple[SegmentationNetwork, list[Recipe]]:
    """Network and history of a checkpoint; where it was made for other classes, the last layer is new.

    Raises OutputError for a file that is not a checkpoint, or, where the classes must be the `same`, one for others.
    """
    network = build(len(classes), None)
    try:
        content = torch.load(path, map_location="cpu", weights_only=True)
        weights = dict(content["network"])
        if content["classes"] != list(classes):
            if same:
                raise OutputError(f"{path}: is for {', '.join(content['classes'])}, not for {', '.join(classes)}")
            weights |= {name: value for name, value in network.state_dict().items() if name.startswith(LAST_LAYER)}
        network.load_state_dict(weights)
        return network, json.loads(content["history"])
    except BROKEN as error:
        raise OutputError(f"{path}: not a checkpoint of `savmap train`; start without it") from error
