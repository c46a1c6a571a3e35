"""The rooms' networks: each loaded once, each picture shown to it once."""

import weakref
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from savmap.errors import ModelError
from savmap.rooms import Room
from savmap.stages.segment import Segmenter
from savmap.types import Detection, View


class Eyes:
    """The rooms' networks. A file that several rooms name is loaded once, and a view they share is segmented once."""

    def __init__(self, rooms: Sequence[Room]) -> None:
        networks = {path: OnceSegmenter(path, 1) for path in dict.fromkeys(room.model for room in rooms)}
        self.networks = {room.name: networks[room.model] for room in rooms}
        for room in rooms:
            missing = set(room.classes) - set(self.networks[room.name].classes)
            if missing:
                raise ModelError(
                    f"{room.model}: the network does not give `{sorted(missing)[0]}`, which `{room.name}` needs"
                )

    def see(self, room: Room, view: View) -> list[Detection]:
        """What a room detects in a view."""
        return room.detect(view=view, segmenter=self.networks[room.name])

    def look_ahead(self, room: Room, view: View) -> None:
        """Ask the network now about what the room will detect; nothing where the room has its own way to detect."""
        if not hasattr(room.plugin, "detect"):
            self.networks[room.name].probabilities(view.image)


class OnceSegmenter(Segmenter):
    """A segmenter that remembers what it said of a picture for as long as that is in use: so rooms which share a view share
    its inference, and it may be asked ahead of them, by other threads."""

    def __init__(self, path: Path, threads: int) -> None:
        super().__init__(path, threads)
        self._said: dict[int, NDArray[np.float32]] = {}

    def probabilities(self, image: NDArray[np.uint8]) -> NDArray[np.float32]:
        if id(image) not in self._said:
            self._said[id(image)] = super().probabilities(image)
            weakref.finalize(image, self._said.pop, id(image), None).atexit = False
        return self._said[id(image)]
