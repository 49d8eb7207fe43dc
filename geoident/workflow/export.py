"""``geoident export``: a result as files for other programs, which appear whole or not at all."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

from geoident.errors import InputError, UsageError
from geoident.io.result.hdf5 import refusal
from geoident.io.result.vtkhdf import (
    REFIT,
    copy_fields,
    sidecar_path,
    sidecar_target,
    write_sidecar,
)
from geoident.io.result.vtu import write_pvd, write_vtu
from geoident.io.text.atomic import atomic_output, output_error
from geoident.model.result import FieldSeries, Result

Writer = Callable[[str], None]


def export_folder(path: str, output: str | None) -> Path:
    """Where the files of a result go: a folder beside it unless one is named.

    >>> export_folder("cases/dam/case.fit.h5", None).as_posix()
    'cases/dam/case.fit.export'
    """
    return Path(path).with_name(f"{stem(path)}.export") if output is None else Path(output)


def stem(path: str) -> str:
    """What the names of the files of a result begin with.

    >>> stem("cases/dam/case.fit.h5")
    'case.fit'
    """
    return Path(path).name.removesuffix(".h5")


def export_texts(
    path: str, texts: Mapping[str, str], *, folder: Path, overwrite: bool
) -> tuple[str, ...]:
    """Write tables, ``FOLDER/RESULT.TABLE.csv``.

    Args:
        path: of the result.
        texts: name of a table to its text.
        folder: made if it is missing.
        overwrite: whether files that exist are replaced.

    Returns:
        The files.
    """
    files: dict[Path, Writer] = {
        folder / f"{stem(path)}.{name}.csv": _text_writer(text) for name, text in texts.items()
    }
    return _write_all(files, overwrite=overwrite)


def _text_writer(text: str) -> Writer:
    def write(part: str) -> None:
        Path(part).write_text(text, encoding="utf-8", newline="")

    return write


def export_vtu(path: str, result: Result, *, folder: Path, overwrite: bool) -> tuple[str, ...]:
    """Write ``FOLDER/RESULT.NN.vtu`` for every state, and ``FOLDER/RESULT.pvd``, their list."""
    fields = _fields(path, result)
    names = state_names(result)
    digits = len(str(len(names) - 1))
    files = [f"{stem(path)}.{state:0{digits}}.vtu" for state in range(len(names))]
    writers: dict[Path, Writer] = {
        folder / file: _state_writer(fields, state) for state, file in enumerate(files)
    }
    writers[folder / f"{stem(path)}.pvd"] = lambda part: write_pvd(files, names, part)
    return _write_all(writers, overwrite=overwrite)


def _state_writer(fields: FieldSeries, state: int) -> Writer:
    return lambda part: write_vtu(fields, state, part)


def state_names(result: Result) -> tuple[str, ...]:
    """The virgin state and the stages that a result holds the fields of."""
    count = len(_fields("", result).present)
    return ("virgin", *result.gauges.stages)[:count]


def export_vtkhdf(path: str, *, folder: Path, overwrite: bool) -> tuple[str, ...]:
    """Write ``FOLDER/RESULT.vtkhdf``, a copy of the fields that needs no result beside it.

    In the folder of the result it is the sidecar that every fit has, a link to the result.
    """
    file = folder / f"{stem(path)}.vtkhdf"
    sidecar, name = sidecar_path(path), Path(path).name
    if sidecar is None or file.resolve() != sidecar.resolve():
        return _write_all({file: lambda part: copy_fields(path, part)}, overwrite=overwrite)
    own = sidecar_target(sidecar) == name
    writers: dict[Path, Writer] = {file: lambda part: write_sidecar(part, name)}
    return _write_all(writers, overwrite=overwrite or own)


def _fields(path: str, result: Result) -> FieldSeries:
    if result.fields is None:
        raise no_fields(path)
    return result.fields


def no_fields(path: str) -> InputError:
    """The refusal of a result without fields."""
    return refusal(path, "no-fields", "holds no displacements and stresses", REFIT)


def _write_all(writers: Mapping[Path, Writer], *, overwrite: bool) -> tuple[str, ...]:
    """Write all files under temporary names, then give them their names."""
    folders = {file.parent for file in writers}
    with ExitStack() as stack:
        for folder in folders:
            stack.enter_context(made_folder(folder))
        parts = {
            file: stack.enter_context(atomic_output(file, overwrite=overwrite)) for file in writers
        }
        for file, part in parts.items():
            writers[file](part)
    return tuple(str(file) for file in writers)


@contextmanager
def made_folder(folder: Path) -> Iterator[None]:
    """Make a folder, and take it away again if the block fails and it is empty."""
    new = not folder.exists()
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise output_error(folder, error) from error
    try:
        yield
    except BaseException:
        if new:
            with suppress(OSError):
                folder.rmdir()
        raise


def refuse_clashes(paths: tuple[str, ...], output: str | None) -> None:
    """Raise where two results would write the same files."""
    names = [str(export_folder(path, output) / stem(path)) for path in paths]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        msg = f"Several results would write the same files: {', '.join(twice)}.*"
        raise UsageError(msg)
