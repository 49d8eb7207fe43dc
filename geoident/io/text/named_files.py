"""Which files the text of a case or of another input names."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

from geoident.errors import InputError
from geoident.io.text.campaign_folder import OVER_ALL, over_all_of
from geoident.io.text.yaml_reader import Node, parse_yaml


def files_of_text(text: str, path: str) -> tuple[str, ...]:
    """Paths of the files that the text of a case names and that exist; none of a faulty text.

    Args:
        text: the case.
        path: where it stands or stood.
    """
    try:
        return named_files(parse_yaml(text, path).data, Path(path).parent)
    except InputError:
        return ()


def named_files(data: Node, folder: Path) -> tuple[str, ...]:
    """Paths of the files that a case names: of every text in it that is the name of a file.

    The folder of a campaign stands for the file of all its runs.

    Args:
        data: the case as mappings, lists and texts.
        folder: against which its paths are meant.
    """
    files: dict[str, None] = {}
    for text in dict.fromkeys(_texts(data)):
        with suppress(OSError, ValueError):  # too long or strange for a name
            path = folder / text
            if path.name != OVER_ALL and not path.exists():  # most texts: to ask is dear
                continue
            over_all = over_all_of(path)
            if over_all is not None and over_all.is_file():
                files[str(over_all)] = None
            elif path.is_file():
                files[str(path)] = None
    return tuple(files)


def _texts(data: Node) -> Iterator[str]:
    if isinstance(data, dict | list):
        for part in data.values() if isinstance(data, dict) else data:
            yield from _texts(part)
    elif data is not None:
        yield data
