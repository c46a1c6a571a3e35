"""What a plugin's class must have, as a type and as a check, and the settings that every plugin takes."""

import difflib
from collections.abc import Iterator, Mapping
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Annotated, Any, Protocol

from pydantic import BaseModel, ConfigDict, Field

from savmap.files.validation import ClassNames
from savmap.plugin import hookspecs
from savmap.types import Structure, Track, ViewPlan

if TYPE_CHECKING:
    from savmap.graph import Constraints


class PluginSettings(BaseModel):
    """Settings that every plugin's `Config` should have; inherit it and add your own, each with a default and a
    docstring."""

    model_config = ConfigDict(extra="forbid", frozen=True, use_attribute_docstrings=True, allow_inf_nan=False)
    model: Path | None = None
    """Another network's ONNX file."""
    class_names: ClassNames = {}
    """What the network's classes (their names, or numbers from 0) are called here, where its own names differ."""
    threshold: Annotated[float, Field(gt=0, lt=1)] = 0.5
    """Confidence above which a pixel belongs to a class."""
    weak_threshold: Annotated[float, Field(gt=0, lt=1)] | None = None
    """Confidence above which it does where nothing nearby is twice as sure. Default: `threshold`."""
    seed_threshold: Annotated[float, Field(gt=0, lt=1)] | None = None
    """Confidence that a connected region must exceed somewhere. Default: `threshold`."""


class KnownSize(BaseModel):
    """A size that was measured, with its standard deviation, both in metres."""

    model_config = ConfigDict(extra="forbid", frozen=True, use_attribute_docstrings=True, allow_inf_nan=False)
    value: Annotated[float, Field(gt=0, lt=100)]
    """Metres."""
    sigma: Annotated[float, Field(gt=0, le=1)] = 0.005
    """Its standard deviation."""


class Plugin(Protocol):
    """A plugin: one structure type, from views to structures in the map.

    The engine makes it with its validated settings, an instance of `Config`. These members are required; so a type
    checker accepts `plugin: type[Plugin] = Pillars` for any class that has them, whether or not it inherits from this
    one. Hooks take any of the arguments that `savmap.plugin.hookspecs` names, by name, which is why they are not typed
    here; what they return is. Hooks with a default (`detect`, `relate`, `cross_row_landmarks`, `evaluate`, `draw`,
    ...) may be left out. What only simulation and training ask is in a class of its own (`savmap.lab.hookspecs`).

    A class may also declare, each optional:

    - `needs_path: bool`: whether the plugin cannot locate the camera. It is then asked to track only where the path is
      known (`start` is never None), and a row that has no other plugin for that ends with an error that says so.
    - `in_every_frame: bool`: whether each frame before a row should show something that it maps, as `count_view_plan`
      plans. Where nothing is mapped in many that glare or show something, the verdict warns of it;
      one that is dark shows that there is none.
    - `after_pixels: tuple[str, ...]`: settings that `render_views`, `detect` and `extract_features` do not use: if one
      changes, the row is only solved again.
    - `scale_settings: tuple[str, ...]`: settings that may give the map's scale; not declared: any may.
    - `reference_names: tuple[str, ...]`: all names of landmarks and coordinates that references of a site file may use,
      with "#" for each number, such as "pillar # / left". Where all plugins of a run say so, a name that none of them
      has is refused before any work.
    - `questions(names: Sequence[str]) -> Iterable[str]`: what is more likely wrong than right with its settings, where
      references use these names; `savmap check` asks it.
    - `Limits: type[BaseModel]`: the limits of its inspection, each with a default; it refuses unknown keys.
    - `ifc_classes: Mapping[str, str]`: by classes of building models, such as "IfcColumn", the label that elements of
      this class have where a survey is imported.
    - `libraries: tuple[str, ...]`: packages without which the plugin does less.
    """

    @property
    def name(self) -> str:
        """The entry point's name, which site files use."""
        ...

    @property
    def classes(self) -> tuple[str, ...]:
        """Classes that the network must give; a feature's label is one of them."""
        ...

    @property
    def model(self) -> Path:
        """The network's ONNX file that comes with the plugin."""
        ...

    @property
    def Config(self) -> type[BaseModel]:  # noqa: N802
        """The settings: a pydantic model with a default for each that refuses unknown keys."""
        ...

    def __init__(self, config: Any) -> None: ...

    def render_views(self, *args: Any, **kwargs: Any) -> ViewPlan: ...

    def track(self, *args: Any, **kwargs: Any) -> list[Track]: ...

    def constrain(self, *args: Any, **kwargs: Any) -> "Constraints": ...

    def describe(self, *args: Any, **kwargs: Any) -> list[Structure]: ...


def class_faults(plugin_class: Any) -> Iterator[str]:
    """What a plugin's class lacks or declares wrongly: attributes first, then hooks."""
    if not isinstance(getattr(plugin_class, "name", None), str):
        yield "`name` must be a string"
    classes = getattr(plugin_class, "classes", None)
    if not (isinstance(classes, tuple) and classes and all(isinstance(label, str) for label in classes)):
        yield "`classes` must be a tuple of names"
    if not isinstance(getattr(plugin_class, "model", None), Path):
        yield "`model` must be a Path"
    names = getattr(plugin_class, "reference_names", ())
    if not (isinstance(names, tuple) and all(isinstance(name, str) for name in names)):
        yield "`reference_names` must be a tuple of names"
    labels = getattr(plugin_class, "ifc_classes", {})
    if not (isinstance(labels, Mapping) and all(isinstance(text, str) for pair in labels.items() for text in pair)):
        yield "`ifc_classes` must be a mapping of classes of IFC to labels"
    config = getattr(plugin_class, "Config", None)
    yield from _model_faults("Config", config)
    if hasattr(plugin_class, "Limits"):
        yield from _model_faults("Limits", plugin_class.Limits)
    if not set(getattr(plugin_class, "scale_settings", ())) <= set(getattr(config, "model_fields", ())):
        yield "`scale_settings` must name settings of `Config`"
    finds = implements(plugin_class, "find")
    for hook in hookspecs.REQUIRED:
        hook = "measure" if finds and hook == "extract_features" else hook
        if not implements(plugin_class, hook):
            who = "one that finds" if hook == "measure" else "every plugin"
            yield f"it lacks the hook `{hook}`, which {who} must have (with @hookimpl)"
    yield from hook_faults(plugin_class, hookspecs)


def hook_faults(plugin_class: Any, specifications: ModuleType) -> Iterator[str]:
    """What a class marks as a hook that the specifications do not have, with the nearest."""
    hooks = {name for name, value in vars(specifications).items() if hasattr(value, "savmap_spec")}
    for name in sorted(set(dir(plugin_class)) - hooks):
        if implements(plugin_class, name):
            near = difflib.get_close_matches(name, hooks, 1)
            yield f"`{name}` is no hook" + (f": did you mean `{near[0]}`?" if near else "")


def implements(plugin: Any, hook: str) -> bool:
    """Whether a plugin's class, or an object of it, has a hook of its own."""
    return hasattr(getattr(plugin, hook, None), "savmap_impl")


def _model_faults(name: str, model: object) -> Iterator[str]:
    """What is wrong with a class's settings."""
    if not (isinstance(model, type) and issubclass(model, BaseModel)):
        yield f"`{name}` must be a pydantic model"
    elif model.model_config.get("extra") != "forbid":
        yield f'`{name}` must refuse unknown keys (extra="forbid")'
    elif any(field.is_required() for field in model.model_fields.values()):
        yield f"every setting of `{name}` needs a default"
