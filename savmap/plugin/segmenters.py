"""The plugins' networks: each loaded once, each picture shown to it once."""

import logging
import weakref
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from savmap.errors import ModelError
from savmap.plugin.manager import LoadedPlugin
from savmap.types import Detection, View
from savmap.vision.networks.adapter import Sight
from savmap.vision.networks.segmenter import Segmenter, few

log = logging.getLogger("savmap")
NetworkKey = tuple[Path, tuple[tuple[str, str], ...], tuple[str, ...]]


class SegmenterPool:
    """The plugins' networks. A file that several plugins name is loaded once, and a view they share is segmented once.

    `notes`: a line for each network that does not run on the processor, or not where it was asked to.
    """

    def __init__(self, plugins: Sequence[LoadedPlugin]) -> None:
        network_keys = {plugin.name: _network_key(plugin) for plugin in plugins}
        networks = {
            network_key: _network(
                network_key, [plugin for plugin in plugins if network_keys[plugin.name] == network_key]
            )
            for network_key in network_keys.values()
        }
        self.networks = {plugin.name: networks[network_keys[plugin.name]] for plugin in plugins}
        self.notes = tuple(dict.fromkeys(line for network in networks.values() for line in _notes(network)))
        for plugin in plugins:
            network = self.networks[plugin.name]
            missing = sorted(set(plugin.classes) - set(network.classes))
            if missing:
                raise ModelError(
                    f"{plugin.model}: the network does not give `{missing[0]}`, which `{plugin.name}` needs; it gives "
                    f"{few(network.names)}: say with `class_names` which of them it is"
                )

    def detections(self, plugin: LoadedPlugin, view: View) -> list[Detection]:
        """What a plugin detects in a view."""
        return plugin.detect(view, self.networks[plugin.name])

    def prefetch(self, plugin: LoadedPlugin, view: View) -> None:
        """Run the network now on what the plugin will be asked about; not where the plugin has a `detect` of its own."""
        if not plugin.has("detect"):
            self.networks[plugin.name].see(view.image)


class OnceSegmenter(Segmenter):
    """A segmenter that keeps its answer for a picture as long as the picture is in use: plugins that share a view share its
    inference, which other threads may have asked for ahead of them."""

    def __init__(self, *network: Any) -> None:
        super().__init__(*network)
        self._said: dict[int, Sight] = {}

    def see(self, image: NDArray[np.uint8]) -> Sight:
        if id(image) not in self._said:
            self._said[id(image)] = super().see(image)
            weakref.finalize(image, self._said.pop, id(image), None).atexit = False
        return self._said[id(image)]


def _network_key(plugin: LoadedPlugin) -> NetworkKey:
    return plugin.model, tuple(sorted(plugin.class_names.items())), plugin.providers


def _network(network_key: NetworkKey, plugins: Sequence[LoadedPlugin]) -> OnceSegmenter:
    path, class_names, providers = network_key
    wanted = {name for plugin in plugins for name in plugin.classes}
    network = OnceSegmenter(path, 1, dict(class_names), wanted, providers)
    log.info("network of %s: %s", " and ".join(plugin.name for plugin in plugins), network)
    return network


def _notes(network: Segmenter) -> Sequence[str]:
    lines = [] if network.provider == "cpu" else [f"network {network}"]
    return [*lines, *([network.note] if network.note else [])]
