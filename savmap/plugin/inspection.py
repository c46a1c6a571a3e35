"""What plugins' `inspect` hooks have in common: limits with their source, as settings, and findings by them."""

from collections.abc import Collection, Iterator
from dataclasses import replace
from typing import Annotated, Any, Self

from pydantic import BaseModel, ConfigDict, Field, ValidationInfo, field_validator, model_validator

from savmap.types import AppliedLimit, Finding, Measured, graded

METRES = "_m"
"""How keys of lengths end."""
UNVERIFIED = "not checked against the standard's text"
"""Of a source that was quoted from memory or from secondary literature."""


class InspectionLimits(BaseModel):
    """Limits that a site may change; inherit it for a plugin's `Limits`, each with a default and a docstring. Whether
    large or small values are bad is as in the default."""

    model_config = ConfigDict(extra="forbid", frozen=True, use_attribute_docstrings=True, allow_inf_nan=False)

    @field_validator("*")
    @classmethod
    def _same_values_are_bad(cls, value: Any, info: ValidationInfo) -> Any:
        usual = cls.model_fields[info.field_name or ""].default
        if isinstance(value, Limit) and isinstance(usual, Limit) and value.large_is_bad != usual.large_is_bad:
            size, order = ("large", "larger") if usual.large_is_bad else ("small", "smaller")
            raise ValueError(
                f"{size} values are bad here, so red must be {order} than amber; it is amber {value.amber:g}, "
                f"red {value.red:g} (usual: {usual.amber:.3g}, {usual.red:.3g})"
            )
        return value

    def graded(self, key: str, finding: Finding, measured: Measured) -> Finding:
        """The finding with the value, graded by the limit with this key, which it names."""
        limit: Limit = getattr(self, key)
        return replace(limit.finding(finding, measured), limit_key=key)


class Limit(InspectionLimits):
    """What is in order up to `amber` and bad beyond `red`, in the unit of what is measured. A default with a smaller
    `red` says that small values are bad, and a site's must then have one, too."""

    amber: Annotated[float, Field(ge=0, strict=True)]
    """From here on it needs attention."""
    red: Annotated[float, Field(ge=0, strict=True)]
    """From here on it is bad."""
    source: str = "the site"
    """Where the limit comes from."""

    @model_validator(mode="after")
    def _limits_differ(self) -> Self:
        if self.amber == self.red:
            raise ValueError("amber and red must differ")
        return self

    @property
    def large_is_bad(self) -> bool:
        """Whether values above the limit are bad."""
        return self.red > self.amber

    def finding(self, finding: Finding, measured: Measured) -> Finding:
        """The finding with the value, graded. Where large values are bad, the sign does not count."""
        size = replace(measured, value=abs(measured.value)) if self.large_is_bad else measured
        grade, limit, probability = graded(size, self.amber, self.red)
        return replace(
            finding,
            grade=grade,
            value=measured.value,
            sigma=measured.sigma,
            limit=limit,
            probability=probability,
            limit_source=self.source,
            action="" if grade == "green" else finding.action,
        )


def limit_lines(limits: BaseModel, keys: Collection[str], prefix: str = "") -> Iterator[AppliedLimit]:
    """Every limit of a model that is set and has one of these keys, for the page of an inspection."""
    source = str(getattr(limits, "source", ""))
    for key, field in type(limits).model_fields.items():
        value, name, meaning = getattr(limits, key), prefix + key, field.description or ""
        if key not in keys or value is None:
            continue
        if isinstance(value, Limit):
            yield AppliedLimit(name, meaning, f"amber {value.amber:.3g}, red {value.red:.3g}", value.source)
        elif isinstance(value, tuple):
            for k, entry in enumerate(value, start=1):
                yield AppliedLimit(f"{name} {k}", meaning, _words(entry), getattr(entry, "source", ""))
        else:
            yield AppliedLimit(name, meaning, f"{value} m" if key.endswith(METRES) else str(value), source)


def _words(entry: object) -> str:
    """The values of a model in words, such as "width 0.8 m", or a value."""
    if not isinstance(entry, BaseModel):
        return str(entry)
    words = []
    for key in type(entry).model_fields:
        value = getattr(entry, key)
        if key != "source" and value not in (None, ()):
            text = ", ".join(map(str, value)) if isinstance(value, tuple) else str(value)
            name = key.removesuffix(METRES).replace("_", " ")
            words.append(f"{name} {text} m" if key.endswith(METRES) else f"{name} {text}")
    return ", ".join(words)
