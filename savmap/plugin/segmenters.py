"""The plugins' networks: each loaded once, each picture segmented once."""

import logging
import weakref
from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from savmap.errors import ModelError
from savmap.plugin.manager import LoadedPlugin
from savmap.types import Detection, View
from savmap.vision.networks.adapter import Segmentation
from savmap.vision.networks.segmenter import Segmenter, shortened

log = logging.getLogger("savmap")
OPEN = 4
NetworkKey = tuple[Path, tuple[tuple[str, str], ...], tuple[str, ...]]


class SegmenterPool:
    """Plugins' networks, of one row or of several. A file that several plugins name is loaded once, and a view that
    they share is segmented once.

    `notes`: a line for each network that does not run on the processor, or not on the provider that was asked for.
    Raises ModelError where a network cannot be opened, or lacks a class that its plugin needs.
    """

    def __init__(self, plugins: Sequence[LoadedPlugin]) -> None:
        sharing: dict[NetworkKey, list[LoadedPlugin]] = {}
        for plugin in plugins:
            sharing.setdefault(_key(plugin), []).append(plugin)
        self._networks = {key: _network(key, named) for key, named in sharing.items()}
        networks = self._networks.values()
        lines = [line for each in networks for line in ("" if each.provider == "cpu" else f"network {each}", each.note)]
        self.notes = tuple(dict.fromkeys(filter(None, lines)))
        for plugin in plugins:
            network = self.network(plugin)
            missing = sorted(set(plugin.classes) - set(network.classes))
            if missing:
                raise ModelError(
                    f"{plugin.model}: the network does not give `{missing[0]}`, which `{plugin.name}` needs; it gives "
                    f"{shortened(network.names)}: say with `class_names` which of them it is"
                )

    def network(self, plugin: LoadedPlugin) -> "CachedSegmenter":
        """The network of one of the plugins."""
        return self._networks[_key(plugin)]

    def detect(self, plugin: LoadedPlugin, view: View) -> list[Detection]:
        """The plugin's detections in a view."""
        return plugin.detect(view, self.network(plugin))

    def predict(self, plugin: LoadedPlugin, view: View) -> Segmentation:
        """What the plugin's network gives for a view."""
        return self.network(plugin).predict(view.image)

    def prefetch(self, plugin: LoadedPlugin, view: View) -> None:
        """Segment a view now, ahead of `detect`; plugins with a `detect` hook of their own may not need it, and are
        left alone."""
        if not plugin.has("detect"):
            self.network(plugin).predict(view.image)


class CachedSegmenter(Segmenter):
    """A segmenter that keeps a picture's segmentation for as long as the picture lives: plugins that share a view share
    its inference, and other threads may run it ahead of them."""

    def __init__(self, *network: Any) -> None:
        super().__init__(*network)
        self._segmentations: dict[int, Segmentation] = {}

    def predict(self, image: NDArray[np.uint8]) -> Segmentation:
        if id(image) not in self._segmentations:
            self._segmentations[id(image)] = super().predict(image)
            weakref.finalize(image, self._segmentations.pop, id(image), None).atexit = False
        return self._segmentations[id(image)]


def _key(plugin: LoadedPlugin) -> NetworkKey:
    return plugin.model, tuple(sorted(plugin.class_names.items())), plugin.providers


def _network(key: NetworkKey, plugins: Sequence[LoadedPlugin]) -> CachedSegmenter:
    path, class_names, providers = key
    wanted = frozenset(name for plugin in plugins for name in plugin.classes)
    changed_ns = path.stat().st_mtime_ns if path.is_file() else 0
    try:
        network = _opened(path, changed_ns, class_names, wanted, providers)
    except ModelError as error:
        raise ModelError(
            f"plugin `{'` and `'.join(dict.fromkeys(plugin.name for plugin in plugins))}`: {error}"
        ) from error
    log.info("network of %s: %s", " and ".join(dict.fromkeys(plugin.name for plugin in plugins)), network)
    return network


@lru_cache(maxsize=OPEN)
def _opened(
    path: Path,
    changed_ns: int,
    class_names: tuple[tuple[str, str], ...],
    wanted: frozenset[str],
    providers: tuple[str, ...],
) -> CachedSegmenter:
    """A network; those used last stay open: views are chosen, rows measured and further rows begun with the same."""
    return CachedSegmenter(path, 1, dict(class_names), set(wanted), providers)


def close_unused() -> None:
    """Close the networks that no pool has."""
    _opened.cache_clear()
