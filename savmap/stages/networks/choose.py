"""Which adapter a file needs, and which of its classes are asked for under which names."""

import difflib
from collections.abc import Collection, Mapping, Sequence

from savmap.errors import ModelError
from savmap.stages.networks import detr, semantic, yolo
from savmap.stages.networks.adapter import Adapter
from savmap.stages.networks.session import Opened


def adapter_for(opened: Opened) -> Adapter:
    """The adapter of an opened file. Raises ModelError where it is of no kind that is taken, or breaks its kind's contract."""
    face, run = opened.face, opened.run
    if semantic.recognises(face):
        return semantic.Semantic(face, run)
    if yolo.recognises(face):
        return yolo.Yolo(face, run)
    if detr.recognises(face):
        return detr.Detr(face, run)
    taken = ", ".join((semantic.LAYOUT, yolo.LAYOUT, detr.LAYOUT))
    raise ModelError(f"{face.path}: a network with {face} is of no kind that is taken: {taken}; see docs/networks.md")


def labels_of(
    names: Sequence[str], class_names: Mapping[str, str], wanted: Collection[str] | None, where: str
) -> tuple[str | None, ...]:
    """For each of a network's classes what it counts as: the name that `class_names` gives for it or for its number, else its own; None
    where that is not among those `wanted`, if any are named. Raises ModelError for a name in `class_names` that the network has not."""
    numbers = {str(number): name for number, name in enumerate(names)}
    for key in class_names:
        if key not in names and key not in numbers:
            near = difflib.get_close_matches(key, names, 1)
            hint = f"did you mean `{near[0]}`?" if near else f"it has {few(names)}"
            raise ModelError(f"{where}: `class_names` names `{key}`, which the network does not give; {hint}")
    found = [class_names.get(name, class_names.get(str(number), name)) for number, name in enumerate(names)]
    return tuple(label if wanted is None or label in wanted else None for label in found)


def few(names: Sequence[str], most: int = 12) -> str:
    """The first of some names, and how many more there are."""
    return ", ".join(names[:most]) + (f" and {len(names) - most} more" if len(names) > most else "")
