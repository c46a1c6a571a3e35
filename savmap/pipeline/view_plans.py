"""Which views of a pass are looked at: each plugin is asked in turn, and what one finds of the face is told to those
after it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial

from savmap.pipeline.lens_walks import LensWalk, lens_walk, with_lens
from savmap.pipeline.trust.footage import require_panoramas
from savmap.plugin.manager import LoadedPlugin
from savmap.plugin.segmenters import SegmenterPool
from savmap.site.model import Pass
from savmap.types import Floats, MapWarning, ViewPlan, ViewSpec
from savmap.video.reader import Clip, preview_frames
from savmap.vision.view_planning import Manual, PassPreview, whole_view
from savmap.vision.views import Renderer


@dataclass(frozen=True, eq=False)
class PassPlan:
    """One pass with the views that each plugin wants of it (`plans`, by plugin); `side`: the hand that the face is on,
    where it is given; `warnings`: what speaks against its pictures; `walk`: of an ordinary lens, what is known of it
    before."""

    name: str
    clip: Clip
    plans: Mapping[str, ViewPlan]
    side: str | None = None
    warnings: tuple[MapWarning, ...] = ()
    walk: LensWalk | None = None

    def travel(self) -> int:
        """Which way the camera goes along the face, by the first plugin that knows; 0 where none does."""
        return next((plan.travel for plan in self.plans.values() if plan.travel), 0)

    def attitude(self) -> Floats | None:
        """world_from_rig (3, 3) at the start, by the first plugin that knows it."""
        return next((plan.world_from_rig for plan in self.plans.values() if plan.world_from_rig is not None), None)

    def locators(self) -> set[str]:
        """The plugins that found the face."""
        return {plugin for plugin, plan in self.plans.items() if plan.world_from_rig is not None}

    def views(self) -> dict[tuple[str, str], ViewSpec]:
        """Views by (plugin, name as the plugin gave it), renamed so that a name is unique in the row."""
        return {
            (plugin, spec.name): replace(spec, name=f"{self.name} / {self._name_of(plugin, spec)}")
            for plugin, plan in self.plans.items()
            for spec in plan.views
        }

    @cached_property
    def plugins_by_view(self) -> dict[ViewSpec, list[str]]:
        """The plugins, by name, that look at each view."""
        views = self.views()
        return {
            spec: [plugin for (plugin, _), other in views.items() if other == spec]
            for spec in dict.fromkeys(views.values())
        }

    def _name_of(self, plugin: str, spec: ViewSpec) -> str:
        """A view's name, with its plugin's before it where another plugin gives another view the same name."""
        alike = [other for plan in self.plans.values() for other in plan.views if other.name == spec.name]
        return spec.name if all(other == spec for other in alike) else f"{plugin} {spec.name}"


def plan_pass(
    name: str,
    row_pass: Pass,
    plugins: Sequence[LoadedPlugin],
    segmenters: SegmenterPool,
    renderer: Renderer,
    attitude: Floats | None,
) -> PassPlan:
    """Look at a pass, and plan its views as `plan_shown` does."""
    row_pass, pass_preview, walk = looked_at(row_pass, renderer)
    return plan_shown(name, row_pass, plugins, pass_preview, attitude, walk, segmenters)


def plan_shown(
    name: str,
    row_pass: Pass,
    plugins: Sequence[LoadedPlugin],
    pass_preview: PassPreview,
    attitude: Floats | None,
    walk: LensWalk | None = None,
    segmenters: SegmenterPool | None = None,
) -> PassPlan:
    """Ask every plugin for its views of a pass, in the order of `face_first`. The attitude that one finds is given to
    those after it.

    `attitude`: world_from_rig (3, 3) of the first frame, where it is known; `walk`: of an ordinary lens; `segmenters`:
    the plugins' networks, where they are open already. Raises VideoError where the pictures are no panoramas,
    StructureError where a plugin finds no structure.
    """
    segmenters = SegmenterPool(plugins) if segmenters is None else segmenters
    warnings = require_panoramas(row_pass.clip, pass_preview.keys)
    plans: dict[str, ViewPlan] = {}
    for plugin in face_first(plugins):
        plans[plugin.name] = plan_views(plugin, row_pass, segmenters, pass_preview, attitude)
        attitude = plans[plugin.name].world_from_rig if attitude is None else attitude
    plans = {plugin.name: plans[plugin.name] for plugin in plugins}
    return PassPlan(name, row_pass.clip, plans, row_pass.side, warnings, walk)


def face_first(plugins: Sequence[LoadedPlugin]) -> list[LoadedPlugin]:
    """The plugins, those first that may find the face, in whatever order they are named: the others' views are turned
    along it."""
    return sorted(plugins, key=lambda plugin: plugin.needs_path)


def looked_at(row_pass: Pass, renderer: Renderer) -> tuple[Pass, PassPreview, LensWalk | None]:
    """A pass with what views are chosen by; of an ordinary lens, with the focal length that its walk tells, and that
    walk. Raises VideoError, StructureError."""
    walk = lens_walk(row_pass)
    if walk is None:
        return row_pass, PassPreview.of_frames(*preview_frames(row_pass.clip), renderer=renderer), None
    row_pass = with_lens(row_pass, walk)
    keys, pairs = preview_frames(row_pass.clip)
    return row_pass, PassPreview(keys, pairs, renderer, walk.world_from_rig_usual.T, walk.travel), walk


def plan_views(
    plugin: LoadedPlugin,
    row_pass: Pass,
    segmenters: SegmenterPool,
    pass_preview: PassPreview,
    attitude: Floats | None,
) -> ViewPlan:
    """The views of a pass that one plugin wants; `attitude` as in `plan_shown`."""
    whole = whole_view(pass_preview.keys[0])
    manual = {"face": whole} if whole is not None else {}
    manual |= {key: Manual(**view.model_dump()) for key, view in row_pass.views.items()}
    predict = partial(segmenters.detect, plugin)
    return plugin.render_views(pass_preview, predict, row_pass.side, manual, attitude)
