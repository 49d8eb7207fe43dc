"""``geoident export``: a result as files for other programs, which appear whole or not at all.

Tables and grids for other programs have no room for a mark of their own, so ``RESULT.sha256``
beside them lists their checksums (``sha256sum --check`` reads it). What stands there as listed was
made from an earlier result of the case, and gives way to what is made now.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from geoident.errors import GeoidentError, OutputError, Term, UsageError
from geoident.io.result.hdf5 import refusal
from geoident.io.result.structure_cells import (
    structure_series,
    write_structures_vtkhdf,
)
from geoident.io.result.vtkhdf import (
    REFIT,
    copy_fields,
    sidecar_path,
    sidecar_target,
    write_sidecar,
)
from geoident.io.result.vtu import write_pvd, write_structures_vtu, write_vtu
from geoident.io.text.atomic import atomic_output, make_folder
from geoident.io.text.mark import marked, origin_of
from geoident.model.arrays import Floats
from geoident.model.results.result import FieldSeries, Result
from geoident.workflow.programs.digest import file_sha256
from geoident.workflow.running.older_files import listed_files, listing_text
from geoident.workflow.running.outputs import kept_results
from geoident.workflow.running.remade import foreign
from geoident.workflow.running.result_files import case_path, files_of_result

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


@dataclass(frozen=True)
class Export:
    """A result and where its files go.

    Args:
        path: of the result.
        result: what it holds.
        folder: of the files; made if it is missing.
        overwrite: whether files that exist are replaced; never one that the command has read.
    """

    path: str
    result: Result
    folder: Path
    overwrite: bool

    def write(self, writers: Mapping[Path, Writer], *, own: bool = False) -> tuple[str, ...]:
        """Write all files under temporary names, then give them their names.

        Args:
            writers: path of a file to what writes it.
            own: they are the result's own, so that they may be replaced.

        Returns:
            The files.

        Raises:
            OutputError: one of them exists, is an input, or cannot be written; none is there then.
        """
        return self._files().write(writers, own=own)

    def _files(self) -> ListedFiles:
        return ListedFiles(
            folder=self.folder,
            stem=stem(self.path),
            case=case_path(self.path, self.result.provenance.case_file),
            inputs=files_of_result(self.result, self.path),
            identity=self.result.provenance.identity,
            overwrite=self.overwrite,
        )


@dataclass(frozen=True)
class ListedFiles:
    """Files that belong together, in a folder with a list of their checksums.

    Args:
        folder: of the files; made if it is missing.
        stem: what their names begin with; the list is ``STEM.sha256``.
        case: path of the case that they are made of.
        inputs: paths of what the command has read, which no file replaces.
        identity: of what they are made of, as the list says it.
        overwrite: whether files that exist are replaced.
    """

    folder: Path
    stem: str
    case: str
    inputs: Sequence[str]
    identity: str
    overwrite: bool

    def write(self, writers: Mapping[Path, Writer], *, own: bool = False) -> tuple[str, ...]:
        """Write all files under temporary names, then give them their names.

        Args:
            writers: path of a file to what writes it.
            own: they may be replaced, and are not listed.

        Returns:
            The files.

        Raises:
            OutputError: one of them exists, is an input, or cannot be written; none is there then.
        """
        listing = self.folder / f"{self.stem}.sha256"
        before, refusal = self._listed(listing)
        with ExitStack() as stack:
            stack.enter_context(made_folder(self.folder))

            def place(file: Path, *, ours: bool) -> str:
                free = self.overwrite or own or ours
                return stack.enter_context(atomic_output(file, overwrite=free, inputs=self.inputs))

            if refusal and not self.overwrite:
                raise OutputError(refusal)
            parts = {file: place(file, ours=_is_listed(file, before)) for file in writers}
            for file, part in parts.items():
                writers[file](part)
            if not own:
                made = {
                    f.name: (file_sha256(Path(part)), self.identity) for f, part in parts.items()
                }
                text = listing_text(before | made)
                part = place(listing, ours=True)
                origin = origin_of([self.case], listing)
                Path(part).write_bytes(marked(text.encode(), "csv", origin))
        return tuple(str(file) for file in writers)

    def _listed(self, listing: Path) -> tuple[dict[str, tuple[str, str]], str]:
        """Files that were made before, as `listed_files`; why the list is to stay as it is."""
        try:
            content = listing.read_bytes()
        except OSError:
            return {}, ""
        why = foreign(content, "csv", [self.case], listing)
        if why:
            remedy = f"{Term.FORCE} replaces it and the files of these names; or give another name"
            return {}, f"{listing}: {why}; it is not overwritten\n    {remedy}"
        known = listed_files(content.decode())
        return {name: one for name, one in known.items() if (self.folder / name).is_file()}, ""


def _is_listed(file: Path, known: Mapping[str, tuple[str, str]]) -> bool:
    """Whether a file is as it was made."""
    return file.name in known and file.is_file() and file_sha256(file) == known[file.name][0]


def export_texts(export: Export, texts: Mapping[str, str]) -> tuple[str, ...]:
    """Write tables, ``FOLDER/RESULT.TABLE.csv``.

    Args:
        export: the result and the folder.
        texts: name of a table to its text.

    Returns:
        The files.
    """
    folder, path = export.folder, export.path
    files: dict[Path, Writer] = {
        folder / f"{stem(path)}.{name}.csv": partial(_write_text, text)
        for name, text in texts.items()
    }
    return export.write(files)


def write_table(
    text: str,
    file: str,
    *,
    path: str,
    result: Result,
    earlier: Callable[[str], str],
    overwrite: bool,
) -> None:
    """Write one table to a file that the user has named; it takes the place of that of before.

    What stands there gives way if it is the table of an earlier result of the place, as is kept.

    Args:
        text: of the table.
        file: where to put it.
        path: of the result.
        result: what it holds.
        earlier: path of an earlier result to the text of its table.
        overwrite: replace any other file.

    Raises:
        OutputError: another file is there, it is an input, or cannot be written.
    """
    try:
        before = Path(file).read_bytes().decode()
    except (OSError, ValueError):
        before = ""
    if before == text:
        return
    free = overwrite or (bool(before) and before in _texts_of_earlier(path, earlier))
    with atomic_output(file, overwrite=free, inputs=files_of_result(result, path)) as part:
        _write_text(text, part)


def _texts_of_earlier(path: str, earlier: Callable[[str], str]) -> Iterator[str]:
    for _, kept in reversed(kept_results(Path(path))):
        with suppress(GeoidentError):  # a file that only looks like a result
            yield earlier(str(kept))


def _write_text(text: str, part: str) -> None:
    Path(part).write_text(text, encoding="utf-8", newline="")


def export_vtu(export: Export) -> tuple[str, ...]:
    """Write ``FOLDER/RESULT.NN.vtu`` for every state, and ``FOLDER/RESULT.pvd``, their list.

    Where there are structures, also those as lines, ``RESULT.structures.NN.vtu``, or, of shells, as
    faces, ``RESULT.shells.NN.vtu``, with their lists; likewise interfaces as faces.

    Raises:
        InputError: the result has no fields.
    """
    path, result, folder = export.path, export.result, export.folder
    fields = _fields(path, result)
    names = state_names(result)
    digits = len(str(len(names) - 1))
    times = _first(result.gauges.series_times, len(names))
    files = [f"{stem(path)}.{state:0{digits}}.vtu" for state in range(len(names))]
    writers: dict[Path, Writer] = {
        folder / file: partial(
            write_vtu, fields, state, varied=result.varied, mechanism=result.mechanism
        )
        for state, file in enumerate(files)
    }
    writers[folder / f"{stem(path)}.pvd"] = lambda part: write_pvd(files, names, part, times)
    return export.write(writers | _structure_writers(export, digits))


def _structure_writers(export: Export, digits: int) -> dict[Path, Writer]:
    """Writers of ``FOLDER/RESULT.structures.NN.vtu``, of shells likewise, and of their lists."""
    folder = export.folder
    writers: dict[Path, Writer] = {}
    result = export.result
    series = structure_series(result.members, result.shells, result.interfaces)
    for kind, states in series.items():
        name = f"{stem(export.path)}.{kind}"
        names = state_names(export.result)[: len(states)]
        times = _first(export.result.gauges.series_times, len(states))
        files = [f"{name}.{state:0{digits}}.vtu" for state in range(len(states))]
        for file, cells in zip(files, states, strict=True):
            writers[folder / file] = partial(write_structures_vtu, cells)
        writers[folder / f"{name}.pvd"] = partial(write_pvd, files, names, times=times)
    return writers


def _first(times: Floats | None, count: int) -> Floats | None:
    """The times of so many states; None for their numbers."""
    return None if times is None else times[:count]


def state_names(result: Result) -> tuple[str, ...]:
    """The virgin state and the stages that a result holds the fields of."""
    count = len(_fields("", result).present)
    return ("virgin", *result.gauges.stages)[:count]


def export_vtkhdf(export: Export) -> tuple[str, ...]:
    """Write ``FOLDER/RESULT.vtkhdf``, a copy of the fields that needs no result beside it.

    Where there are structures, also ``RESULT.structures.vtkhdf`` with them as lines, and
    ``RESULT.shells.vtkhdf`` with shells as faces; likewise interfaces.

    In the folder of the result it is the sidecar that every fit has, a link to the result.

    Raises:
        InputError: the result has no fields.
    """
    path, folder = export.path, export.folder
    _fields(path, export.result)
    file = folder / f"{stem(path)}.vtkhdf"
    result = export.result
    series = structure_series(result.members, result.shells, result.interfaces)
    structures: dict[Path, Writer] = {
        folder / f"{stem(path)}.{kind}.vtkhdf": partial(
            write_structures_vtkhdf, states, times=result.gauges.series_times
        )
        for kind, states in series.items()
    }
    sidecar, name = sidecar_path(path), Path(path).name
    if sidecar is None or file.resolve() != sidecar.resolve():
        return export.write({file: lambda part: copy_fields(path, part)} | structures)
    own = sidecar_target(sidecar) == name
    written = export.write({file: lambda part: write_sidecar(part, name)}, own=own)
    return (*written, *(export.write(structures) if structures else ()))


def _fields(path: str, result: Result) -> FieldSeries:
    if result.fields is None:
        raise refusal(path, "no-fields", "holds no displacements and stresses", REFIT)
    return result.fields


@contextmanager
def made_folder(folder: Path) -> Iterator[None]:
    """Make a folder, and take it away again if the block fails and it is empty.

    Raises:
        OutputError: it cannot be made.
    """
    new = not folder.exists()
    make_folder(folder)
    try:
        yield
    except BaseException:
        if new:
            with suppress(OSError):
                folder.rmdir()
        raise


def refuse_clashes(paths: tuple[str, ...], output: str | None) -> None:
    """Refuse results that would write the same files.

    Raises:
        UsageError: with the files.
    """
    names = [str(export_folder(path, output) / stem(path)) for path in paths]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        msg = f"Several results would write the same files: {', '.join(twice)}.*"
        raise UsageError(msg)
