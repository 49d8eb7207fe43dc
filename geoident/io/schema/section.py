"""What all sections of a case file have in common: keys, faults among them, where they stand."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NoReturn

from pydantic import BaseModel, ConfigDict, ValidationInfo, model_validator
from pydantic_core import PydanticCustomError

from geoident.io.schema.values import Given
from geoident.io.text.faults import Faults
from geoident.model.case import Analysis, KeyPath

SECTION_FAULTS = "section_faults"
"""Type of the pydantic error that carries several faults of one section."""


class Section(BaseModel):
    """A mapping of the case file. Unknown keys are refused, after noting those that are known."""

    model_config = ConfigDict(extra="forbid", frozen=True, populate_by_name=True, defer_build=True)

    @model_validator(mode="before")
    @classmethod
    def _note_keys(cls, data: Any, info: ValidationInfo) -> Any:
        """Remember which keys this mapping may have, for did-you-mean."""
        if isinstance(info.context, dict):
            known = tuple(f.alias or name for name, f in cls.model_fields.items())
            info.context[id(data)] = known
        return data

    @property
    def numbers(self) -> list[Given]:
        """The numbers of the section itself, not of what is below it."""
        values = [getattr(self, name) for name in type(self).model_fields]
        return [part for value in values if isinstance(value, Given) for part in value.parts]


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

    def vector(self, given: Sequence[Given], what: str) -> tuple[float, ...] | None:
        """Components (dim,) in SI units; None, with a fault, where there are more or fewer.

        Args:
            given: the components as written.
            what: they are of, for the message.
        """
        if len(given) == self.dim:
            return tuple(number.factor for number in given)
        axes = ", ".join("xyz"[: self.dim])
        message = f"{what} has {len(given)} components; {self.dim} expected ({axes})"
        hint = f"'analysis' says that there are {self.dim}: correct it or the components."
        self.refuse("wrong-dimension", message, hint)
        return None


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


def refuse(path: KeyPath, code: str, message: str, hint: str = "") -> NoReturn:
    """Refuse a section for one fault.

    Args:
        path: of the key, from the section on.
        code: short stable name of the kind of fault.
        message: what was found and what is expected.
        hint: the likely remedy.

    Raises:
        PydanticCustomError: always.
    """
    fault = SectionFault(path, code, message, hint)
    raise PydanticCustomError(SECTION_FAULTS, "faults in a section", {"found": [fault]})


def require_one_of(
    section: Section, ways: Sequence[Sequence[str]], expected: str, hint: str
) -> None:
    """Refuse a section whose keys are none of the ways in which something can be said.

    Args:
        section: the section.
        ways: sets of keys, in the order of the section.
        expected: what is expected, ending with its verb.
        hint: the remedy.

    Raises:
        PydanticCustomError: the keys given are another set.
    """
    known = dict.fromkeys(name for way in ways for name in way)
    given = [name for name in known if getattr(section, name) is not None]
    if given not in [list(way) for way in ways]:
        message = f"found {' and '.join(given) or 'no constants'}; {expected} expected"
        refuse((), "wrong-pair", message, hint)
