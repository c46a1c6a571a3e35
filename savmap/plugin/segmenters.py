"""The rooms' networks: each loaded once, each picture shown to it once."""

import logging
import weakref
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from savmap.errors import ModelError
from savmap.plugin.manager import Room
from savmap.types import Detection, View
from savmap.vision.networks.adapter import Sight
from savmap.vision.networks.segmenter import Segmenter, few

log = logging.getLogger("savmap")
Wish = tuple[Path, tuple[tuple[str, str], ...], tuple[str, ...]]


class Eyes:
    """The rooms' networks. A file that several rooms name is loaded once, and a view they share is segmented once.

    `notes`: a line for each network that does not run on the processor, or not where it was asked to.
    """

    def __init__(self, rooms: Sequence[Room]) -> None:
        wishes = {room.name: _wish(room) for room in rooms}
        networks = {
            wish: _network(wish, [room for room in rooms if wishes[room.name] == wish]) for wish in wishes.values()
        }
        self.networks = {room.name: networks[wishes[room.name]] for room in rooms}
        self.notes = tuple(dict.fromkeys(line for network in networks.values() for line in _notes(network)))
        for room in rooms:
            network = self.networks[room.name]
            missing = sorted(set(room.classes) - set(network.classes))
            if missing:
                raise ModelError(
                    f"{room.model}: the network does not give `{missing[0]}`, which `{room.name}` needs; it gives "
                    f"{few(network.names)}: say with `class_names` which of them it is"
                )

    def see(self, room: Room, view: View) -> list[Detection]:
        """What a room detects in a view."""
        return room.detect(view=view, segmenter=self.networks[room.name])

    def look_ahead(self, room: Room, view: View) -> None:
        """Ask the network now about what the room will detect; nothing where the room has its own way to detect."""
        if not hasattr(room.instance, "detect"):
            self.networks[room.name].see(view.image)


class OnceSegmenter(Segmenter):
    """A segmenter that remembers what it said of a picture for as long as that is in use: so rooms which share a view share
    its inference, and it may be asked ahead of them, by other threads."""

    def __init__(self, *network: Any) -> None:
        super().__init__(*network)
        self._said: dict[int, Sight] = {}

    def see(self, image: NDArray[np.uint8]) -> Sight:
        if id(image) not in self._said:
            self._said[id(image)] = super().see(image)
            weakref.finalize(image, self._said.pop, id(image), None).atexit = False
        return self._said[id(image)]


def _wish(room: Room) -> Wish:
    return room.model, tuple(sorted(room.class_names.items())), room.providers


def _network(wish: Wish, rooms: Sequence[Room]) -> OnceSegmenter:
    path, class_names, providers = wish
    wanted = {name for room in rooms for name in room.classes}
    network = OnceSegmenter(path, 1, dict(class_names), wanted, providers)
    log.info("network of %s: %s", " and ".join(room.name for room in rooms), network)
    return network


def _notes(network: Segmenter) -> Sequence[str]:
    told = [] if network.provider == "cpu" else [f"network {network}"]
    return [*told, *([network.note] if network.note else [])]
