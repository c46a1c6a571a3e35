"""Which of a plugin's networks looks at a row: the one that sees more of the structure in the first pass.

A network that was trained on one kind of pictures may hardly see the structure in another. A plugin may come with
further networks (`further_models` of its class); they are asked about the same views, in a few frames, and one takes
the place of the plugin's own where it sees clearly more, or where the plugin's own does not find the structure at all.
A network that the user names is left alone.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from savmap.errors import StructureError
from savmap.pipeline.lens_walks import LensWalk
from savmap.pipeline.trust.footage import require_panoramas
from savmap.pipeline.view_plans import PassPlan, face_first, looked_at, plan_views
from savmap.plugin.manager import LoadedPlugin
from savmap.plugin.segmenters import SegmenterPool
from savmap.site.model import Pass
from savmap.types import Floats, View, ViewPlan
from savmap.vision.view_planning import PassPreview
from savmap.vision.views import Renderer

CLEARLY, MOST_LOST, LEAST_SHARE = 1.17, 0.8, 1e-3
"""A further network may be set to see faint things (logits raised in training): up to a sixth more of what both see
well is no more seen."""

Candidate = tuple[LoadedPlugin, SegmenterPool]
"""A plugin with one of its networks, opened."""


def further_models(plugin: LoadedPlugin) -> tuple[Path, ...]:
    """The networks that a plugin comes with beside its own; none where the user names one."""
    if getattr(plugin.config, "model", None):
        return ()
    return tuple(getattr(plugin.instance, "further_models", ()))


def with_best_networks(
    name: str,
    row_pass: Pass,
    plugins: Sequence[LoadedPlugin],
    preview: PassPreview,
    attitude: Floats | None,
    walk: LensWalk | None = None,
) -> tuple[Sequence[LoadedPlugin], PassPlan]:
    """The plugins with the networks that see most in a pass, the first, and the views that they want of it, asked in
    the order of `face_first`. The attitude that one finds is given to those after it (`attitude`: world_from_rig (3, 3)
    of the first frame, where it is known; `walk`: of an ordinary lens).

    Raises StructureError where a plugin finds no structure with any of its networks, VideoError where the pictures are
    no panoramas.
    """
    warnings = require_panoramas(row_pass.clip, preview.keys)
    chosen: dict[str, tuple[LoadedPlugin, ViewPlan]] = {}
    for plugin in face_first(plugins):
        chosen[plugin.name] = with_best_network(
            plugin, preview, partial(_views_of, row_pass=row_pass, preview=preview, attitude=attitude)
        )
        attitude = chosen[plugin.name][1].world_from_rig if attitude is None else attitude
    plans = {plugin.name: chosen[plugin.name][1] for plugin in plugins}
    plan = PassPlan(name, row_pass.clip, plans, row_pass.side, warnings, walk)
    return [chosen[plugin.name][0] for plugin in plugins], plan


def best_for_pass(row_pass: Pass, plugin: LoadedPlugin, renderer: Renderer) -> LoadedPlugin:
    """The plugin with the network that sees most in a pass. Raises StructureError where it finds no structure with any
    of its networks."""
    if not further_models(plugin):
        return plugin
    row_pass, preview, walk = looked_at(row_pass, renderer)
    (chosen,), _ = with_best_networks("pass 1", row_pass, [plugin], preview, None, walk)
    return chosen


def network_lines(plugins: Sequence[LoadedPlugin]) -> list[str]:
    """A line for each plugin that looks with another network than its own."""
    changed = [plugin for plugin in plugins if plugin.network is not None]
    return [f"`{plugin.name}` looks with {plugin.model.name}, which sees more here" for plugin in changed]


def with_best_network(
    plugin: LoadedPlugin, preview: PassPreview, plan: Callable[[Candidate], ViewPlan]
) -> tuple[LoadedPlugin, ViewPlan]:
    """The plugin with one of its networks, and what it plans with that: its own, or the first with which it finds the
    structure, unless another sees clearly more in the same views. Raises StructureError where none finds it."""
    missed: StructureError | None = None
    others = further_models(plugin)
    for loaded in (plugin, *(replace(plugin, network=model) for model in others)):
        candidate = _opened(loaded)
        try:
            planned = plan(candidate)
        except StructureError as error:
            missed = missed or error
            continue
        if plugin.failure is not None or loaded is not plugin or not others:
            return plugin if plugin.failure is not None else loaded, planned
        best = with_most_seen(candidate, others, [view for spec in planned.views for view in preview.views(spec)])
        return best[0], planned if best is candidate else plan(best)
    raise missed or StructureError(f"`{plugin.name}` finds no structure")


def with_most_seen(first: Candidate, others: Sequence[Path], views: Sequence[View]) -> Candidate:
    """The network that sees most in some views: the plugin's first, unless another sees clearly more."""
    if not views:
        return first
    best, most = first, seen(first, views)
    for model in others:
        other = _opened(replace(first[0], network=model))
        shares = seen(other, views)
        if sees_more(shares, most):
            best, most = other, shares
    return best


def seen(candidate: Candidate, views: Sequence[View]) -> Floats:
    """The share of the views' pixels (classes,) that the plugin's network takes for each of its classes."""
    plugin, segmenters = candidate
    maps = [segmenters.predict(plugin, view).maps[1:] > plugin.threshold for view in views]
    return np.asarray(np.mean(maps, axis=(0, 2, 3)), np.float64)


def sees_more(shares: Floats, others: Floats) -> bool:
    """Whether shares (classes,) are clearly more than others on the whole, and not much less of any class."""
    ratio = (shares + LEAST_SHARE) / (others + LEAST_SHARE)
    return bool(ratio.min() > MOST_LOST and np.exp(np.log(ratio).mean()) > CLEARLY)


def _opened(plugin: LoadedPlugin) -> Candidate:
    return plugin, SegmenterPool([plugin])


def _views_of(candidate: Candidate, row_pass: Pass, preview: PassPreview, attitude: Floats | None) -> ViewPlan:
    plugin, segmenters = candidate
    return plan_views(plugin, row_pass, segmenters, preview, attitude)
