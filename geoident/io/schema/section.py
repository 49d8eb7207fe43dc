"""What all sections of a case file have in common: keys, faults among them, where they stand."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, ClassVar, Self, TypeVar

from pydantic import BaseModel, ConfigDict, Field, ValidationInfo, model_validator
from pydantic_core import PydanticCustomError

from geoident.io.schema.values import CaseNumber, Components
from geoident.io.text.faults import Faults
from geoident.model.arrays import Vector
from geoident.model.case import Analysis, KeyPath

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

T = TypeVar("T", bound="DataclassInstance")

SECTION_FAULTS = "section_faults"
"""Type of the pydantic error that carries several faults of one section."""


def optional(description: str, **given: Any) -> Any:
    """A key that may be left out: None then.

    Args:
        description: what it says, in sentences for the page of keys.
        **given: see `pydantic.Field`, such as ``examples``.
    """
    return Field(None, description=description, **given)


class Alternatives:
    """Ways to say one thing, of which a section takes exactly one; the order of keys is free.

    Args:
        ways: the keys of each way as users write them, those that may be left out with a question
            mark, such as ``dip dip_direction?``; empty where nothing needs to be said.
        hint: the remedy where the keys given are none of the ways.
    """

    def __init__(self, *ways: str, hint: str) -> None:
        self.hint = hint
        keys = [way.split() for way in ways]
        self._needed = [[key for key in way if not key.endswith("?")] for way in keys]
        self._optional = [[key[:-1] for key in way if key.endswith("?")] for way in keys]

    @property
    def keys(self) -> list[str]:
        """Names of all keys, each once."""
        ways = zip(self._needed, self._optional, strict=True)
        return list(dict.fromkeys(key for way in ways for key in (*way[0], *way[1])))

    @property
    def nothing(self) -> str:
        """What is found where no key is given."""
        return "neither" if len(self._needed) == 2 else "none of them"

    def fits(self, given: Sequence[str]) -> bool:
        """Whether the keys given are those of one way."""
        ways = zip(self._needed, self._optional, strict=True)
        return any(set(must) <= set(given) <= {*must, *may} for must, may in ways)

    def words(self, mark: str = "") -> str:
        """The ways in words.

        Args:
            mark: around the names of keys.
        """
        ways = []
        for must, may in zip(self._needed, self._optional, strict=True):
            more = f" (with {_listed(may, mark)})" if may else ""
            ways.append(f"{_listed(must, mark)}{more}" if must else "none of them")
        return ", or ".join(ways)


def _listed(keys: Sequence[str], mark: str) -> str:
    *first, last = (f"{mark}{key}{mark}" for key in keys)
    return f"{', '.join(first)} and {last}" if first else last


def _describe_ways(schema: dict[str, Any], section: type[Section]) -> None:
    """Name the ways of a section in the schema, and so on the page of keys."""
    ways = "".join(f"\n\nExactly one of: {one.words('`')}." for one in section.one_of)
    if ways:
        schema["description"] = schema.get("description", "") + ways


class Section(BaseModel):
    """A mapping of the case file. Unknown keys are refused, after noting those that are known."""

    model_config = ConfigDict(
        extra="forbid",
        frozen=True,
        populate_by_name=True,
        defer_build=True,
        json_schema_extra=_describe_ways,
    )
    one_of: ClassVar[tuple[Alternatives, ...]] = ()
    not_here: ClassVar[Mapping[str, str]] = MappingProxyType({})
    """Keys that one may expect, since neighbours have them, and what to do without them."""
    builds: ClassVar[type[DataclassInstance]]
    """The class of the model whose attributes are keys of the section."""

    @model_validator(mode="before")
    @classmethod
    def _note_keys(cls, data: Any, info: ValidationInfo) -> Any:
        """Remember whose keys this mapping has, for what is said of unknown ones."""
        if isinstance(info.context, dict):
            info.context[id(data)] = cls
        return data

    @model_validator(mode="after")
    def _judge(self) -> Self:
        """Refuse keys that are none of the ways in which something can be said; then `check`."""
        faults = SectionFaults()
        names = {f.alias or name: name for name, f in type(self).model_fields.items()}
        for one in self.one_of:
            given = [key for key in one.keys if getattr(self, names[key]) is not None]
            if not one.fits(given):
                keys = _listed(given, "") if given else one.nothing
                message = f"found {keys}; expected {one.words()}"
                faults.add((), "wrong-pair", message, one.hint)
        if not faults.found:
            self.check(faults)
        faults.raise_any()
        return self

    def check(self, faults: SectionFaults) -> None:
        """Note what is wrong between the keys of a section, each of which is right by itself."""

    def for_model(self, context: Context) -> Any:
        """What the section says, for the model; what cannot be is noted as a fault.

        Args:
            context: of the section.
        """
        return self.to_model(self.builds, context)

    def to_model(self, kind: type[T], context: Context | None = None, /, **given: Any) -> T:
        """What the section says as a class of the model, whose attributes have the names of keys.

        Numbers become SI, lists tuples, and sections below it what they build. A key that is
        missing leaves the default of the model.

        Args:
            kind: a dataclass of the model.
            context: of the section; None where no key has coordinates or a section.
            given: attributes that are no keys, or take more than that.
        """
        keys = type(self).model_fields
        values = {
            f.name: _built(
                getattr(self, f.name), context and context.at(keys[f.name].alias or f.name)
            )
            for f in fields(kind)
            if f.name in keys and f.name not in given
        }
        return kind(**{key: x for key, x in values.items() if x is not None}, **given)

    @classmethod
    def key_names(cls) -> tuple[str, ...]:
        """Its keys as users write them."""
        return tuple(f.alias or name for name, f in cls.model_fields.items())

    @property
    def numbers(self) -> list[CaseNumber]:
        """The numbers of the section itself, not of what is below it."""
        values = [getattr(self, name) for name in type(self).model_fields]
        return [part for value in values if isinstance(value, CaseNumber) for part in value.parts]


def _built(value: Any, context: Context | None) -> Any:
    """What stands under a key as the model has it."""
    if isinstance(value, CaseNumber):
        return value.value
    if isinstance(value, Section):
        assert context is not None
        return value.for_model(context)
    if isinstance(value, Components) and context is not None and not context.has_axes(value):
        return context.nowhere
    if isinstance(value, list):
        return tuple(_built(part, context and context.at(n)) for n, part in enumerate(value))
    if isinstance(value, Mapping):
        return {key: _built(part, context and context.at(key)) for key, part in value.items()}
    return value


@dataclass(frozen=True)
class Context:
    """Where a section stands that is built into the model, and what the case is about.

    Args:
        path: keys that lead to the section.
        analysis: kind of analysis of the case.
        faults: where what cannot be is noted.
    """

    path: KeyPath
    analysis: Analysis
    faults: Faults

    @property
    def dim(self) -> int:
        """Space dimensions of the mesh."""
        return self.analysis.dim

    def at(self, *keys: str | int) -> Context:
        """The same for what stands under these keys."""
        return replace(self, path=(*self.path, *keys))

    def refuse(self, code: str, message: str, hint: str = "", *, key: bool = False) -> None:
        """Note a fault at the value that stands here.

        Args:
            code: short stable name of the kind of fault.
            message: what was found and what is expected.
            hint: the likely remedy.
            key: the fault is that of the key itself.
        """
        self.faults.add(self.path, code, message, hint, key=key)

    @property
    def nowhere(self) -> Vector:
        """(dim,) coordinates of no point; no two of them are equal."""
        return tuple(float("nan") for _ in range(self.dim))

    def has_axes(self, given: Sequence[CaseNumber]) -> bool:
        """Whether there is one component for each axis; a fault where there are more or fewer."""
        if len(given) != self.dim:
            axes = ", ".join("xyz"[: self.dim])
            message = f"found {len(given)}; expected {self.dim} components ({axes})"
            hint = f"'analysis' says that there are {self.dim}: correct it or the components."
            self.refuse("wrong-dimension", message, hint)
        return len(given) == self.dim

    def vector(self, given: Sequence[CaseNumber]) -> Vector:
        """Components (dim,) in SI units; NaN, with a fault, where there are more or fewer."""
        return tuple(number.factor for number in given) if self.has_axes(given) else self.nowhere


@dataclass(frozen=True)
class SectionFault:
    """A fault inside a section, with its path from there."""

    path: KeyPath
    code: str
    message: str
    hint: str


@dataclass
class SectionFaults:
    """Collects what is wrong within one section, where it takes several keys to see it."""

    found: list[SectionFault] = field(default_factory=list)

    def add(self, path: KeyPath, code: str, message: str, hint: str = "") -> None:
        """Note a fault.

        Args:
            path: of the key, from the section on.
            code: what kind of fault it is, for programs.
            message: what is wrong.
            hint: what would be right.
        """
        self.found.append(SectionFault(path, code, message, hint))

    def raise_any(self) -> None:
        """Tell pydantic.

        Raises:
            PydanticCustomError: there are faults.
        """
        if self.found:
            raise PydanticCustomError(SECTION_FAULTS, "faults in a section", {"found": self.found})
