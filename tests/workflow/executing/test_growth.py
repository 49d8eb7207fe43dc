"""Files that grow while a task goes on: what is told, in which pieces, and how it is kept here."""

from dataclasses import dataclass, field
from pathlib import Path
from queue import Empty, SimpleQueue

import pytest

from geoident.workflow.executing import growth
from geoident.workflow.executing.growth import (
    GrowthWatch,
    Resumable,
    add_lines,
    found_in,
    keep,
)


@dataclass(frozen=True)
class Writing(Resumable):
    """A task that writes two files."""

    growing: tuple[str, ...] = ("log.jsonl", "points.h5")


@dataclass
class Told:
    """What a watch over process 7 in a folder tells, one part after the other."""

    folder: Path
    parts: SimpleQueue = field(default_factory=SimpleQueue)

    def watch(self, task):
        return GrowthWatch(3, task, lambda: [7], self.place, self.parts.put, 0.001)

    def place(self, process):
        assert process == 7
        return self.folder

    def next(self):
        part = self.parts.get(timeout=60.0)
        assert part.number == 3
        return part.file, part.at, part.content

    def silent(self):
        with pytest.raises(Empty):
            self.parts.get_nowait()
        return True


@pytest.fixture
def told(tmp_path):
    return Told(tmp_path)


def add(path, content):
    with path.open("ab") as file:
        file.write(content)


def test_what_is_added_is_told_once_with_the_place_where_it_begins(told, tmp_path):
    file = tmp_path / "points.h5"
    with told.watch(Writing({})):
        add(file, b"one")
        assert told.next() == ("points.h5", 0, b"one")
        add(file, b"two")
        assert told.next() == ("points.h5", 3, b"two")
    assert told.silent()


def test_of_a_file_that_was_sent_only_what_follows_is_told(told, tmp_path):
    add(tmp_path / "points.h5", b"sent and more")
    with told.watch(Writing({"points.h5": b"sent"})):
        assert told.next() == ("points.h5", 4, b" and more")


def test_lines_are_told_whole_and_not_those_of_earlier_tasks(told, tmp_path):
    file = tmp_path / "log.jsonl"
    add(file, b"earlier\n")
    with told.watch(Writing({"log.jsonl": b"what was sent does not count\n"})):
        add(file, b"one\ntw")
        assert told.next() == ("log.jsonl", 8, b"one\n")
        add(file, b"o\n")
        assert told.next() == ("log.jsonl", 12, b"two\n")


def test_a_process_that_comes_later_tells_all_its_lines(told, tmp_path):
    processes = []
    add(tmp_path / "log.jsonl", b"one\n")
    task = Writing({"log.jsonl": b"what was sent does not count\n"})
    with GrowthWatch(3, task, lambda: processes, told.place, told.parts.put, 0.001):
        processes.append(7)
        assert told.next() == ("log.jsonl", 0, b"one\n")


def test_much_comes_in_pieces_and_too_much_is_not_told(told, tmp_path, monkeypatch):
    monkeypatch.setattr(growth, "_PIECE", 4)
    monkeypatch.setattr(growth, "_MOST", 10)
    add(tmp_path / "points.h5", b"0123456789")
    with told.watch(Writing({})):
        assert [told.next() for _ in range(3)] == [
            ("points.h5", 0, b"0123"), ("points.h5", 4, b"4567"), ("points.h5", 8, b"89"),
        ]  # fmt: skip
        add(tmp_path / "points.h5", b"!")
        add(tmp_path / "log.jsonl", b"end\n")
        assert told.next() == ("log.jsonl", 0, b"end\n")
    assert told.silent()


def test_what_nobody_took_is_told_again(told, tmp_path):
    refusals = [ConnectionError("nobody"), ConnectionError("nobody")]

    def tell(part):
        if refusals:
            raise refusals.pop()
        told.parts.put(part)

    add(tmp_path / "points.h5", b"one")
    with GrowthWatch(3, Writing({}), lambda: [7], told.place, tell, 0.001):
        assert told.next() == ("points.h5", 0, b"one")


def test_other_tasks_are_not_watched(told, tmp_path):
    add(tmp_path / "points.h5", b"one")
    with told.watch("task") as watch:
        assert not watch._thread.is_alive()
    assert told.silent()


def test_what_is_found_is_what_is_there(tmp_path):
    add(tmp_path / "points.h5", b"one")
    assert found_in(Writing({}), tmp_path) == {"points.h5": b"one"}


def test_a_task_that_is_resumed_has_the_newest_of_all_files():
    task = Writing({"a": b"1", "b": b"2"}).resumed({"b": b"3"})
    assert task.kept == {"a": b"1", "b": b"3"}
    assert task.growing == ("log.jsonl", "points.h5")


def test_pieces_go_where_they_belong_and_shorten_what_is_longer(tmp_path):
    file = tmp_path / "deep" / "points.h5"
    keep(file, b"0123")
    keep(file, b"45", at=4)
    assert file.read_bytes() == b"012345"
    keep(file, b"lost", at=7)  # the piece before has not come
    assert file.read_bytes() == b"012345"
    keep(file, b"x", at=2)  # another process has begun again
    assert file.read_bytes() == b"01x"
    keep(tmp_path / "new.h5", b"lost", at=1)
    assert not (tmp_path / "new.h5").exists()


def test_of_lines_each_is_kept_once(tmp_path):
    file = tmp_path / "deep" / "log.jsonl"
    keep(file, b"one\ntwo\none\n\n", at=99)
    keep(file, b"two\nthree\n")
    assert file.read_bytes() == b"one\ntwo\nthree\n"
    before = file.stat().st_mtime_ns
    add_lines(file, b"three\n")
    assert file.stat().st_mtime_ns == before
