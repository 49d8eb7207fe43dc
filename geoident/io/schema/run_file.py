"""What files of campaigns, projects and clusters have in common; how the first two set values."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

from pydantic import AfterValidator, BaseModel, ValidationError

from geoident.errors import Location
from geoident.io.schema.faults import add_schema_faults
from geoident.io.schema.section import Section
from geoident.io.schema.values import Name, kind_of
from geoident.io.text.faults import Faults, Places
from geoident.io.text.kinds import refuse_other_kind
from geoident.io.text.overrides import parse_path, written_value
from geoident.io.text.text_file import decode, read_bytes
from geoident.io.text.wording import Refusal, shorten
from geoident.io.text.yaml_reader import MAX_BYTES, parse_yaml
from geoident.model.case import KeyPath
from geoident.model.run import Setting

S = TypeVar("S", bound=BaseModel)
FileKind = Literal["campaign", "project", "cluster"]


def require_value_path(text: str) -> str:
    """The path of a value of a case, as it is written.

    Raises:
        Refusal: it is none.
    """
    try:
        parse_path(text)
    except Refusal as error:
        message = f"'{shorten(text)}' is not the path of a value of a case"
        raise Refusal(error.code, message, error.hint) from error
    return text


ValuePath = Annotated[Name, AfterValidator(require_value_path)]
Settings = dict[ValuePath, Any]
"""Path of a value of a case to what takes its place."""


def open_run_file(path: str, what: FileKind) -> Faults:
    """Read the text of a file; its data and the places of its keys, without faults so far.

    Raises:
        InputError: it is no such file, or no YAML.
    """
    document = parse_yaml(decode(read_bytes(path, limit=MAX_BYTES, what=what), path), path)
    refuse_other_kind(document, what)
    return Faults(Places(document, document.data))


def validated(section: type[S], faults: Faults, what: FileKind) -> S:
    """The keys of a file.

    Args:
        section: that declares them.
        faults: has the data, and what is wrong so far with files that they name.
        what: kind of file.

    Raises:
        InputError: with all faults.
    """
    data = faults.places.data
    if not isinstance(data, dict):
        hint = f"Begin with 'format: geoident-{what}/1'."
        faults.add((), "wrong-kind", f"found {kind_of(data)}; expected a mapping", hint)
    sections: dict[int, type[Section]] = {}
    try:
        return section.model_validate(data, context=sections)
    except ValidationError as error:
        if isinstance(data, dict):
            add_schema_faults(faults, error.errors(include_url=False), data, sections)
        faults.raise_any()
        raise


def require_file(path: Path, key: KeyPath, faults: Faults, what: FileKind) -> bool:
    """Whether there is a file that a key names; a fault is noted where there is none.

    Args:
        path: of the file.
        key: that names it.
        faults: takes the fault.
        what: kind of the file that has the key.
    """
    if is_file(path):
        return True
    hint = f"Paths are meant from the folder of the {what} file."
    faults.add(key, "missing-file", f"there is no file '{shorten(path)}'", hint)
    return False


def is_file(path: Path) -> bool:
    """Whether there is a file; no path is too long or too strange to be asked for."""
    try:
        return path.is_file()
    except (OSError, ValueError):
        return False


def settings_of(
    values: Mapping[str, Any], at: KeyPath, faults: Faults
) -> tuple[tuple[Setting, ...], tuple[Location, ...]]:
    """What a mapping of a file sets, and where each of it is written.

    Args:
        values: path of a value of a case to what takes its place.
        at: key of the mapping.
        faults: knows the places.
    """
    settings = tuple((path, written_value(value)) for path, value in values.items())
    return settings, tuple(faults.places.locate((*at, path)) for path in values)
