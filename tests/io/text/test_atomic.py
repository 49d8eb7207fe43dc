from __future__ import annotations

import errno
import os
import stat
import subprocess
import sys
from pathlib import Path

import pytest

from geoident.errors import ExitCode, OutputError
from geoident.io.text import atomic
from geoident.io.text.atomic import atomic_output, make_folder


def names_in(folder: Path) -> list[str]:
    return sorted(entry.name for entry in folder.iterdir())


def write(path: Path, text: str, *, overwrite: bool = False) -> None:
    with atomic_output(path, overwrite=overwrite, inputs=()) as temporary:
        Path(temporary).write_text(text)


def raise_(error: BaseException) -> None:
    raise error


def dead_pid() -> int:
    process = subprocess.Popen([sys.executable, "-c", ""])
    process.wait()
    return process.pid


def test_file_appears_complete_and_alone(tmp_path: Path) -> None:
    path = tmp_path / "a.h5"
    with atomic_output(path, overwrite=False, inputs=()) as temporary:
        assert Path(temporary).name == f".a.h5.{os.getpid()}.part"
        assert Path(temporary).parent == tmp_path
        assert not path.exists()
        Path(temporary).write_text("new")
    assert path.read_text() == "new"
    assert names_in(tmp_path) == ["a.h5"]


def test_existing_file_is_kept_without_overwrite(tmp_path: Path) -> None:
    path = tmp_path / "a.h5"
    path.write_text("old")
    with pytest.raises(OutputError, match=r"exists already.*\n.*--force") as caught:
        write(path, "new")
    assert caught.value.exit_code == ExitCode.OUTPUT
    assert path.read_text() == "old"
    write(path, "new", overwrite=True)
    assert path.read_text() == "new"
    assert names_in(tmp_path) == ["a.h5"]


@pytest.mark.parametrize("links", [True, False])
def test_file_that_appears_meanwhile_is_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, links: bool
) -> None:
    path = tmp_path / "a.h5"
    if not links:
        monkeypatch.setattr(Path, "hardlink_to", raising(errno.EPERM))
    output = atomic_output(path, overwrite=False, inputs=())
    temporary = output.__enter__()
    Path(temporary).write_text("new")
    path.write_text("of another run")
    with pytest.raises(OutputError, match="exists already"):
        output.__exit__(None, None, None)
    assert path.read_text() == "of another run"
    assert names_in(tmp_path) == ["a.h5"]


def test_file_system_without_hard_links(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Path, "hardlink_to", raising(errno.EOPNOTSUPP))
    write(tmp_path / "a.h5", "new")
    assert (tmp_path / "a.h5").read_text() == "new"
    assert names_in(tmp_path) == ["a.h5"]


@pytest.mark.parametrize("kind", [ValueError, KeyboardInterrupt, SystemExit])
def test_failure_leaves_the_old_file_and_nothing_else(
    tmp_path: Path, kind: type[BaseException]
) -> None:
    path = tmp_path / "a.h5"
    path.write_text("old")
    output = atomic_output(path, overwrite=True, inputs=())
    Path(output.__enter__()).write_text("half")
    error = kind()
    with pytest.raises(kind):
        output.__exit__(kind, error, None) or raise_(error)
    assert path.read_text() == "old"
    assert names_in(tmp_path) == ["a.h5"]


def raising(number: int):
    def fail(*_: object, **__: object) -> None:
        raise OSError(number, os.strerror(number))

    return fail


@pytest.mark.parametrize("function", ["fsync", "open"])
@pytest.mark.parametrize(
    ("number", "remedy"),
    [
        (errno.ENOSPC, "free some space"),
        (errno.EDQUOT, "free some space"),
        (errno.EACCES, "permission"),
        (errno.EROFS, "-o"),
        (errno.EIO, "-o"),
    ],
)
def test_system_errors_become_output_errors(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, function: str, number: int, remedy: str
) -> None:
    path = tmp_path / "a.h5"
    path.write_text("old")
    monkeypatch.setattr(atomic.os, function, raising(number))
    with pytest.raises(OutputError) as caught:
        write(path, "new", overwrite=True)
    monkeypatch.undo()
    said, hint = str(caught.value).split("\n")
    assert said == f"{path}: cannot be written: {os.strerror(number)}"
    assert remedy in hint
    assert path.read_text() == "old"
    assert names_in(tmp_path) == ["a.h5"]


def test_full_disk_in_the_block(tmp_path: Path) -> None:
    output = atomic_output(tmp_path / "a.h5", overwrite=False, inputs=())
    with pytest.raises(OutputError, match="No space left"), output:
        Path("/dev/full").write_text("x")
    assert names_in(tmp_path) == []


def test_a_folder_is_not_made_where_a_file_is(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match="it is a file; expected a folder here"):
        make_folder(tmp_path / "file")
    make_folder(tmp_path / "one" / "two")
    assert (tmp_path / "one" / "two").is_dir()


def test_places_that_cannot_hold_a_file(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "loop").symlink_to("loop")
    with pytest.raises(OutputError, match=r"the folder .*none does not exist\n.*create the folder"):
        write(tmp_path / "none" / "a.h5", "")
    with pytest.raises(OutputError, match=r"Not a directory\n.*is a file, not a folder"):
        write(tmp_path / "file" / "a.h5", "")
    with pytest.raises(OutputError, match="it is a folder"):
        write(tmp_path, "", overwrite=True)
    with pytest.raises(OutputError, match="not a regular file"):
        write(tmp_path / "pipe", "", overwrite=True)
    with pytest.raises(OutputError, match=r"too long\n.*shorter name"):
        write(tmp_path / ("a" * 250), "")
    with pytest.raises(OutputError):
        write(tmp_path / "loop" / "a.h5", "")
    assert names_in(tmp_path) == ["file", "loop", "pipe"]


@pytest.mark.skipif(os.geteuid() == 0, reason="permissions do not bind root")
def test_read_only_folder(tmp_path: Path) -> None:
    tmp_path.chmod(0o555)
    with pytest.raises(OutputError, match=r"Permission denied\n.*permission"):
        write(tmp_path / "a.h5", "")
    tmp_path.chmod(0o755)


def test_symbolic_link_is_followed(tmp_path: Path) -> None:
    (tmp_path / "store").mkdir()
    (tmp_path / "store" / "real.h5").write_text("old")
    (tmp_path / "a.h5").symlink_to("store/real.h5")
    write(tmp_path / "a.h5", "new", overwrite=True)
    assert (tmp_path / "a.h5").is_symlink()
    assert (tmp_path / "store" / "real.h5").read_text() == "new"


def test_temporaries_of_dead_runs_are_swept(tmp_path: Path) -> None:
    dead = dead_pid()
    gone = [f".a.h5.{dead}.part", f".a.h5.{os.getpid()}.part", f".a.h5.{10**30}.part"]
    stay = [f".a.h5.{os.getppid()}.part", f".b.h5.{dead}.part", ".a.h5.x.part", f".a.h5.{dead}"]
    for name in gone + stay:
        (tmp_path / name).write_text("")
    write(tmp_path / "a.h5", "new")
    assert names_in(tmp_path) == sorted([*stay, "a.h5"])


def test_many_files_wait_for_the_disk_but_not_for_their_names(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    synced: list[bool] = []
    once = os.fsync
    monkeypatch.setattr(
        os, "fsync", lambda file: synced.append(stat.S_ISDIR(os.fstat(file).st_mode)) or once(file)
    )
    with atomic.names_may_be_lost():
        write(tmp_path / "a.h5", "new")
    assert synced == [False]
    write(tmp_path / "b.h5", "new")
    assert synced == [False, False, True]


KILLED = """
import os, signal, sys
from pathlib import Path
from geoident.io.text import atomic

def run(path, last):
    lines = 0
    def count(frame, event, argument):
        nonlocal lines
        if event == "line" and frame.f_code.co_filename == atomic.__file__:
            lines += 1
            if lines == last:
                os.kill(os.getpid(), signal.SIGKILL)
        return count
    sys.settrace(count)
    with atomic.atomic_output(path, overwrite=True, inputs=()) as temporary:
        Path(temporary).write_text("new")
    os._exit(0)

folder, last, status = Path(sys.argv[1]), 0, 1
while status:
    last += 1
    (folder / str(last)).mkdir()
    path = folder / str(last) / "a.h5"
    path.write_text("old")
    child = os.fork()
    if child == 0:
        run(path, last)
    status = os.waitpid(child, 0)[1]
"""


def test_kill_on_any_line_leaves_the_old_file_or_the_new_one(tmp_path: Path) -> None:
    subprocess.run([sys.executable, "-c", KILLED, str(tmp_path)], check=True)
    found = []
    for number in range(1, len(names_in(tmp_path)) + 1):
        path = tmp_path / str(number) / "a.h5"
        found.append(path.read_text())
        assert len(names_in(path.parent)) <= 2
        write(path, "again", overwrite=True)
        assert names_in(path.parent) == ["a.h5"]
    assert found == sorted(found, reverse=True)
    assert set(found) == {"old", "new"}
    assert len(found) > 40
