"""What all sections of a case file have in common."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from pydantic import BaseModel, ConfigDict, ValidationInfo, model_validator
from pydantic_core import PydanticCustomError

from geoident.model.case import KeyPath

WRONGS = "wrongs"
"""Type of the pydantic error that carries several faults of one section."""


class Section(BaseModel):
    """A mapping of the case file. Unknown keys are refused, after noting those that are known."""

    model_config = ConfigDict(extra="forbid", frozen=True, populate_by_name=True)

    @model_validator(mode="before")
    @classmethod
    def _note_keys(cls, data: Any, info: ValidationInfo) -> Any:
        """Remember which keys this mapping may have, for did-you-mean."""
        if isinstance(info.context, dict):
            known = tuple(f.alias or name for name, f in cls.model_fields.items())
            info.context[id(data)] = known
        return data


@dataclass(frozen=True)
class Wrong:
    """A fault inside a section, with its path from there."""

    path: KeyPath
    code: str
    message: str
    hint: str


@dataclass
class Wrongs:
    """Collects what is wrong within one section, where it takes several keys to see it."""

    found: list[Wrong] = field(default_factory=list)

    def add(self, path: KeyPath, code: str, message: str, hint: str = "") -> None:
        """Note a fault.

        Args:
            path: of the key, from the section on.
            code: what kind of fault it is, for programs.
            message: what is wrong.
            hint: what would be right.
        """
        self.found.append(Wrong(path, code, message, hint))

    def raise_any(self) -> None:
        """Tell pydantic.

        Raises:
            PydanticCustomError: there are faults.
        """
        if self.found:
            raise PydanticCustomError(WRONGS, "faults in a section", {"found": self.found})


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
        wrongs = Wrongs()
        message = f"found {' and '.join(given) or 'no constants'}; {expected} expected"
        wrongs.add((), "wrong-pair", message, hint)
        wrongs.raise_any()
