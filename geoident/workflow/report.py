"""``geoident report``: figures of a result, as files."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import ExitStack
from pathlib import Path

from geoident.io.atomic import atomic_output
from geoident.io.result_file import read_result
from geoident.model.result import Result


def write_figures(
    path: str,
    *,
    names: tuple[str, ...],
    folder: str,
    suffix: str,
    overwrite: bool,
    save: Callable[[Result, Mapping[str, str]], None],
) -> tuple[str, ...]:
    """Draw a result into files ``folder/NAME.suffix``, which appear whole or not at all.

    Args:
        path: the result.
        names: the figures.
        folder: where to put them; made if it is missing.
        suffix: ``svg``, ``png`` or ``pdf``.
        overwrite: whether files that exist are replaced.
        save: draws the figures into files (name to path).

    Returns:
        The files.
    """
    result = read_result(path)
    Path(folder).mkdir(parents=True, exist_ok=True)
    outputs = tuple(str(Path(folder) / f"{name}.{suffix}") for name in names)
    with ExitStack() as stack:
        parts = {
            name: stack.enter_context(atomic_output(output, overwrite=overwrite))
            for name, output in zip(names, outputs, strict=True)
        }
        save(result, {name: str(part) for name, part in parts.items()})
    return outputs
