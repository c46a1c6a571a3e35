"""What `savmap train` is asked to do."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

Progress = Callable[[float, str], None]
"""Called with the share done (0..1) and a line to show."""


@dataclass(frozen=True)
class Task:
    """A network for `classes`, to be trained on the data sets `data` for some `minutes` and written to `output` (ONNX).

    `init` is what to begin with: a checkpoint, or an ONNX file for fine-tuning; None for a network from nothing. `mapping` gives
    classes of the data sets the network's names. `held_out` are sets that fine-tuning only measures on; `int8`: whether it also
    writes the network in 8-bit integers. `steps`: how many to make, however long they take.
    """

    classes: Sequence[str]
    data: Sequence[Path]
    output: Path
    minutes: float
    seed: int = 0
    init: Path | None = None
    mapping: Mapping[str, str] = field(default_factory=dict)
    held_out: Sequence[Path] = ()
    int8: bool = False
    steps: int | None = None

    def done(self, steps: int, spent_s: float) -> float:
        """The share 0..1 of the run that is done after so many steps and seconds."""
        return min(steps / self.steps if self.steps else spent_s / (60 * self.minutes), 1.0)

    @property
    def checkpoint(self) -> Path:
        """The averaged weights, to go on from."""
        return self.output.with_suffix(".checkpoint.pt")

    @property
    def integers(self) -> Path:
        """The network in 8-bit integers: shelves.onnx -> shelves.int8.onnx."""
        return self.output.with_suffix(".int8.onnx")

    @property
    def fine_tunes(self) -> bool:
        """Whether a network that was exported is trained further."""
        return self.init is not None and self.init.suffix == ".onnx"
