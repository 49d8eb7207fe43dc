"""Output files that are either the old one or the new one, whatever happens on the way.

A file is written under a temporary name in the folder of its final name, synced to the disk, and
only then given its final name; that last step is one indivisible operation of the file system. A
run that dies (kill -9, power) leaves at most its temporary, ``.NAME.<pid>.part``, which the
next run that writes NAME removes once the process of that number is gone.

No output replaces an input of its command, whatever the options: every output says here what its
command reads.
"""

from __future__ import annotations

import errno
import os
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from pathlib import Path

from geoident.errors import OutputError, Term

_ELSEWHERE = f"choose another place with {Term.OUTPUT}"
_REMEDIES = {
    errno.ENOENT: f"create the folder, or {_ELSEWHERE}",
    errno.ENOTDIR: f"a part of the path is a file, not a folder; {_ELSEWHERE}",
    errno.EACCES: f"ask for permission to write in this folder, or {_ELSEWHERE}",
    errno.EPERM: f"ask for permission to write in this folder, or {_ELSEWHERE}",
    errno.EROFS: _ELSEWHERE,
    errno.ENOSPC: f"free some space and try again, or {_ELSEWHERE}",
    errno.EDQUOT: f"free some space and try again, or {_ELSEWHERE}",
    errno.EFBIG: "raise the limit on file sizes (ulimit -f), or write to another file system",
    errno.ENAMETOOLONG: f"choose a shorter name with {Term.OUTPUT}",
    errno.ELOOP: "the path is a symbolic link that leads to itself; remove it",
}
_NAMES_LAST: ContextVar[bool] = ContextVar("_NAMES_LAST", default=True)
_UNSUPPORTED = {errno.EINVAL, errno.EACCES, errno.ENOTSUP, errno.ENOSYS}


@contextmanager
def atomic_output(path: str | Path, *, overwrite: bool, inputs: Iterable[str]) -> Iterator[str]:
    """Gives a temporary path to write to, and puts it in the place of ``path`` on success.

    A symbolic link is followed: the file that it points to is written.

    Args:
        path: the final name.
        overwrite: replace an existing file; otherwise it is an error, also if it appears meanwhile.
        inputs: paths of what the command reads, none of which is ever replaced.

    Yields:
        The path of an empty file in the same folder, to be written by the block.

    Raises:
        OutputError: the place cannot be written, the disk is full, the file exists or is an input.
            Every ``OSError`` of the block counts as one of the output. Nothing is left behind.
    """
    temporary: Path | None = None
    refuse_inputs(path, inputs)
    try:
        final = Path(os.path.realpath(path))
        _refuse_unwritable(path, final, overwrite=overwrite)
        _sweep(final)
        temporary = _create(final)
        yield str(temporary)
        sync(temporary, os.O_RDWR)
        _publish(temporary, final, overwrite=overwrite)
        if _NAMES_LAST.get():
            _sync_folder(final.parent)
    except OSError as error:
        raise output_error(path, error) from error
    finally:
        if temporary is not None:
            with suppress(OSError):
                temporary.unlink(missing_ok=True)


@contextmanager
def names_may_be_lost() -> Iterator[None]:
    """Meanwhile a power failure may take away a file that was just written, but never half of it.

    For many files of which each is made again when it is missing: to have the disk hold a name
    takes as long as to have it hold the file.
    """
    token = _NAMES_LAST.set(False)
    try:
        yield
    finally:
        _NAMES_LAST.reset(token)


def refuse_inputs(path: str | Path, inputs: Iterable[str]) -> None:
    """Refuse an output that is one of the files that its command reads.

    Links and other spellings of a path are seen through; a file that is not there is in no danger.

    Args:
        path: of the output.
        inputs: paths of what is read.

    Raises:
        OutputError: the output is one of them.
    """
    for name in inputs:
        if _same_file(path, name):
            also = "" if str(path) == name else f" ({name})"
            raise OutputError(
                f"{path}: is an input of this {Term.COMMAND}{also} and is never replaced\n"
                "    give the output another name"
            )


def refuse_link(path: str | Path) -> None:
    """Refuse a symbolic link in place of a file that geoident adds to, or replaces without asking.

    Such files lie in folders of geoident's own: who has put a link there means another file.

    Args:
        path: of the file, which need not be there.

    Raises:
        OutputError: it is a link.
    """
    if Path(path).is_symlink():
        raise OutputError(
            f"{path}: is a symbolic link, to which nothing is written\n    remove the link"
        )


def _same_file(one: str | Path, other: str | Path) -> bool:
    try:
        return Path(one).samefile(other)
    except (OSError, ValueError):  # one of them is not there
        return False


def make_folder(folder: Path | str) -> None:
    """Make a folder for output if it is missing.

    Raises:
        OutputError: it cannot be made.
    """
    try:
        Path(folder).mkdir(parents=True, exist_ok=True)
    except FileExistsError as error:
        reason = "it is a file; expected a folder here"
        raise OutputError(f"{folder}: cannot be written: {reason}\n    {_ELSEWHERE}") from error
    except OSError as error:
        raise output_error(folder, error) from error


def output_error(path: str | Path, error: Exception) -> OutputError:
    """An `OutputError` that names the place, what the system said, and the remedy."""
    number = getattr(error, "errno", None)
    reason = os.strerror(number) if number else str(error)
    if number == errno.ENOENT:
        reason = f"the folder {Path(path).parent} does not exist"
    remedy = _REMEDIES.get(number or 0, _ELSEWHERE)
    return OutputError(f"{path}: cannot be written: {reason}\n    {remedy}")


def _refuse_unwritable(path: str | Path, final: Path, *, overwrite: bool) -> None:
    if final.is_dir():
        raise OutputError(f"{path}: cannot be written: it is a folder\n    {_ELSEWHERE}")
    if final.exists() and not final.is_file():
        raise OutputError(f"{path}: cannot be written: not a regular file\n    {_ELSEWHERE}")
    if final.exists() and not overwrite:
        raise _exists(path)


def _exists(path: str | Path) -> OutputError:
    return OutputError(
        f"{path}: exists already and is not overwritten\n"
        f"    {Term.FORCE} replaces it; or give another name"
    )


def _create(final: Path) -> Path:
    temporary = final.with_name(f".{final.name}.{os.getpid()}.part")
    os.close(os.open(temporary, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o666))
    return temporary


def _sweep(final: Path) -> None:
    """Removes temporaries of this file whose process is gone (or had our own number)."""
    start = f".{final.name}."
    with suppress(OSError), os.scandir(final.parent) as entries:
        left = [entry.name for entry in entries if entry.name.startswith(start)]
        for name in left:
            pid = name.removeprefix(start).removesuffix(".part")
            if name == f"{start}{pid}.part" and pid.isdecimal() and not _runs(int(pid)):
                (final.parent / name).unlink()


def _runs(pid: int) -> bool:
    """Whether another process of that number is alive; on Windows, where that is unknown, yes."""
    if pid == os.getpid():
        return False
    if sys.platform == "win32":
        return True
    try:
        os.kill(pid, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except PermissionError:
        pass
    return True


def sync(path: Path, flags: int) -> None:
    """Has the disk hold what was written to a file or a folder, opened with these flags."""
    file = os.open(path, flags)
    try:
        os.fsync(file)
    finally:
        os.close(file)


def _publish(temporary: Path, final: Path, *, overwrite: bool) -> None:
    """Gives the file its name. A hard link, unlike a rename, fails where the name is taken."""
    if overwrite:
        temporary.replace(final)
        return
    try:
        final.hardlink_to(temporary)
    except FileExistsError:
        raise _exists(final) from None
    except (OSError, NotImplementedError):  # file systems without hard links
        if final.exists():
            raise _exists(final) from None
        temporary.replace(final)


def _sync_folder(folder: Path) -> None:
    """Makes the new name durable; some systems and file systems cannot, and need not be told."""
    if sys.platform == "win32":
        return
    try:
        sync(folder, os.O_RDONLY)
    except OSError as error:
        if error.errno not in _UNSUPPORTED:
            raise
