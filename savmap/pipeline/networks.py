"""Which of a plugin's networks looks at a row: the one that sees more of the structure in the first pass.

A network that was trained on one kind of pictures may hardly see the structure in another. A plugin may come with further networks
(`further_models` of its class); they are asked about the same views, in a few frames, and one takes the place of the plugin's own where
it sees clearly more, or where the plugin's own does not find the structure at all. A network that the user names is left alone.
"""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from savmap.plugin.manager import LoadedPlugin
from savmap.plugin.segmenters import SegmenterPool
from savmap.types import Floats, View, ViewSpec
from savmap.vision.view_planning import PassPreview

FRAMES = 6
CLEARLY, MOST_LOST, LEAST_SHARE = 1.08, 0.8, 1e-3


def further_models(plugin: LoadedPlugin) -> tuple[Path, ...]:
    """The networks that a plugin comes with beside its own; none where the user names one."""
    if getattr(plugin.config, "model", None):
        return ()
    return tuple(getattr(plugin.instance, "further_models", ()))


def with_best_network(plugin: LoadedPlugin, specs: Sequence[ViewSpec], preview: PassPreview) -> LoadedPlugin:
    """The plugin with the network that sees most in some views of a pass: its own, unless another sees clearly more."""
    views = few_views(specs, preview)
    if not views:
        return plugin
    best, most = plugin, seen(plugin, views)
    for model in further_models(plugin):
        other = replace(plugin, network=model)
        shares = seen(other, views)
        if sees_more(shares, most):
            best, most = other, shares
    return best


def few_views(specs: Sequence[ViewSpec], preview: PassPreview) -> list[View]:
    """The views in a few key frames, evenly chosen."""
    chosen = np.unique(np.linspace(0, len(preview.keys) - 1, FRAMES).astype(int))
    return [preview.renderer.render(preview.keys[number], spec) for number in chosen for spec in specs]


def seen(plugin: LoadedPlugin, views: Sequence[View]) -> Floats:
    """The share of the views' pixels (classes,) that the plugin's network takes for each of its classes."""
    segmenters = SegmenterPool([plugin])
    maps = [segmenters.predict(plugin, view).maps[1:] > plugin.threshold for view in views]
    return np.asarray(np.mean(maps, axis=(0, 2, 3)), np.float64)


def sees_more(shares: Floats, others: Floats) -> bool:
    """Whether shares (classes,) are clearly more than others on the whole, and not much less of any class."""
    ratio = (shares + LEAST_SHARE) / (others + LEAST_SHARE)
    return bool(ratio.min() > MOST_LOST and np.exp(np.log(ratio).mean()) > CLEARLY)
