"""Settings of the shelves in a site file."""

from collections.abc import Callable
from typing import Annotated, Any, Self

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, model_validator

from savmap.plugin import PluginSettings

Pitch = Annotated[float, Field(gt=0.3, lt=20)]
Height = Annotated[float, Field(gt=-1, lt=10)]


def _alone(key: str) -> Callable[[Any], Any]:
    """Lets a bay's values stand alone, without their `key` and a sigma."""
    return lambda given: {key: given} if isinstance(given, int | float | list | tuple) else given


def _one_known(values: tuple[float | None, ...]) -> tuple[float | None, ...]:
    if all(value is None for value in values):
        raise ValueError("no value is given; leave the setting out, or give that of one bay at least")
    return values


class LowestBeam(BaseModel):
    """Height of the bottom edge of the lowest beam (h_ref of the paper): one value, or one a bay in order, metres.

    The values may stand alone, without a sigma.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, use_attribute_docstrings=True, allow_inf_nan=False)
    values: Height | Annotated[tuple[Height | None, ...], AfterValidator(_one_known)]
    """One value, or one a bay, left to right: `null` where a bay has no beam, or was not measured."""
    sigma: Annotated[float, Field(gt=0, le=1)] = 0.002
    """Standard deviation of each."""

    _values_alone = model_validator(mode="before")(_alone("values"))


class BayPitch(BaseModel):
    """Distance from an upright's edge to the same edge of the next: one value for all bays, or one a bay, metres.

    The values may stand alone, without a sigma.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, use_attribute_docstrings=True, allow_inf_nan=False)
    value: Pitch | Annotated[tuple[Pitch | None, ...], AfterValidator(_one_known)]
    """One value, or one a bay, left to right: `null` where a bay was not measured."""
    sigma: Annotated[float, Field(gt=0, le=1)] = 0.003
    """Standard deviation of each."""

    _values_alone = model_validator(mode="before")(_alone("value"))


class ShelvesSettings(PluginSettings):
    """Settings of the plugin in a site file."""

    weak_threshold: Annotated[float, Field(gt=0, lt=1)] = 0.3
    """Confidence above which it does where nothing nearby is twice as sure."""
    seed_threshold: Annotated[float, Field(gt=0, lt=1)] = 0.75
    """Confidence that a connected region must exceed somewhere, or it is passed over."""
    every: Annotated[int, Field(gt=0)] = 1
    """The face is measured in every n-th key frame."""
    lowest_beam_bottom_height_m: LowestBeam | None = None
    """Height of the bottom edge of the lowest beam, in all bays or bay by bay, left to right."""
    bay_pitch_m: BayPitch | None = None
    """From an upright's edge to the same edge of the next."""
    beam_setback_m: Annotated[float, Field(ge=-0.2, le=0.2)] = 0.005
    """How far the beams' faces stand behind the uprights', to 1 cm; labels and scratches on them tell it better, where
    they show."""
    depth_m: Annotated[float, Field(gt=0.1, le=5)] | None = None
    """The rack's depth, from the front of its frames to their back, for formats that hold solids. Default: 1.1 m, which
    is marked as assumed."""
    plumb: bool = False
    """Whether it is measured how far each upright leans and is bowed along the aisle, and each beam is tilted and sags
    (attributes `lean_permille`, `bow_permille`, `tilt_permille` and `sag_m`), for `savmap inspect`. What clearly leans
    or is tilted is straightened for the solve; else nothing of the map depends on it."""

    @model_validator(mode="after")
    def _as_many_of_each(self) -> Self:
        if len(self._counts) > 1:
            listed = " and ".join(map(str, sorted(self._counts)))
            raise ValueError(f"`lowest_beam_bottom_height_m` and `bay_pitch_m` have one value a bay, not {listed}")
        return self

    @property
    def _counts(self) -> set[int]:
        lists = (
            self.lowest_beam_bottom_height_m and self.lowest_beam_bottom_height_m.values,
            self.bay_pitch_m and self.bay_pitch_m.value,
        )
        return {len(values) for values in lists if isinstance(values, tuple)}

    @property
    def values_given(self) -> int:
        """For how many bays values are listed; 0 where none are."""
        return max(self._counts, default=0)
