from __future__ import annotations

import errno
import os
import subprocess
import sys
import time
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest

from geoident.io.result import checkpoint
from geoident.io.result.checkpoint import EvaluationLog

P = np.array([1.5e10, 0.1 + 0.2])
ARRAYS = {"readings": np.array([1e-3, np.nan, -0.0]), "jacobian": np.arange(6.0).reshape(3, 2)}


def same(a: Mapping[str, np.ndarray] | None, b: Mapping[str, np.ndarray]) -> bool:
    return a is not None and {k: v.tobytes() for k, v in a.items()} == {
        k: v.tobytes() for k, v in b.items()
    }


def filled(path: Path, count: int = 3) -> list[int]:
    """Makes a log and tells the size of the file after each evaluation, from none on."""
    log = EvaluationLog.open(path, "id")
    sizes = [path.stat().st_size]
    for number in range(count):
        log.add("jacobian", P + number, ARRAYS)
        sizes.append(path.stat().st_size)
    log.close()
    return sizes


def test_evaluations_are_found_again(tmp_path: Path) -> None:
    path = tmp_path / "a.checkpoint"
    with EvaluationLog.open(path, "id") as log:
        assert log.find("readings", P) is None
        log.add("readings", P, {"file": ARRAYS["readings"]})
        log.add("jacobian", P, ARRAYS)
        log.add("readings", np.empty(0), {})
        assert same(log.find("jacobian", P), ARRAYS)
    with EvaluationLog.open(path, "id") as log:
        assert log.trouble is None
        assert len(log) == 3
        assert same(log.find("readings", P), {"file": ARRAYS["readings"]})
        assert same(log.find("jacobian", P), ARRAYS)
        assert same(log.find("readings", np.empty(0)), {})
        found = log.find("jacobian", P)
        assert found is not None
        assert found["jacobian"].shape == (3, 2)


def test_a_model_of_milliseconds_does_not_wait_for_the_disk_each_time(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    now, waited = [5.0], []
    monkeypatch.setattr(checkpoint.time, "monotonic", lambda: now[0])
    monkeypatch.setattr(checkpoint.os, "fsync", lambda file: waited.append(now[0]))
    with EvaluationLog.open(tmp_path / "a", "id") as log:
        waited.clear()  # a new log is made once
        for number in range(10):
            now[0] = 5.0 + 0.25 * number
            log.add("jacobian", P + number, ARRAYS)
    assert waited == [5.0, 6.0, 7.0]


def test_only_the_very_same_point_is_found(tmp_path: Path) -> None:
    with EvaluationLog.open(tmp_path / "a", "id") as log:
        log.add("readings", P, ARRAYS)
        assert log.find("readings", np.array([1.5e10, 0.3])) is None
        assert log.find("jacobian", P) is None
        assert log.find("readings", P[::-1]) is None
        assert log.find("readings", np.stack([P, P])[:, :][0]) is not None
        assert log.find("readings", np.repeat(P, 2)[::2]) is not None


def test_other_identity_is_replaced(tmp_path: Path) -> None:
    filled(tmp_path / "a")
    with EvaluationLog.open(tmp_path / "a", "other") as log:
        assert len(log) == 0
        log.add("readings", P, ARRAYS)
    with EvaluationLog.open(tmp_path / "a", "id") as log:
        assert len(log) == 0


@pytest.mark.parametrize("content", [b"", b"x", b"geoident-evaluations/1\n", os.urandom(500)])
def test_damaged_beginning_is_replaced(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "a").write_bytes(content)
    with EvaluationLog.open(tmp_path / "a", "id") as log:
        assert (log.trouble, len(log)) == (None, 0)
        log.add("readings", P, ARRAYS)
    with EvaluationLog.open(tmp_path / "a", "id") as log:
        assert len(log) == 1


def test_record_cut_anywhere_is_dropped_and_the_rest_kept(tmp_path: Path) -> None:
    path = tmp_path / "a"
    sizes = filled(path)
    whole = path.read_bytes()
    for size in [*range(sizes[2], sizes[3], 37), sizes[3] - 1, sizes[2] + 11, sizes[2] + 12]:
        path.write_bytes(whole[:size])
        with EvaluationLog.open(path, "id") as log:
            assert (log.trouble, len(log)) == (None, 2)
            assert path.stat().st_size == sizes[2]
            log.add("jacobian", P + 2, ARRAYS)
        assert path.read_bytes() == whole


def test_flipped_byte_drops_its_record_and_what_follows(tmp_path: Path) -> None:
    path = tmp_path / "a"
    sizes = filled(path)
    whole = path.read_bytes()
    for place in [*range(sizes[1], sizes[1] + 12), *range(sizes[1] + 12, sizes[2], 23)]:
        broken = bytearray(whole)
        broken[place] ^= 0xFF
        path.write_bytes(broken)
        with EvaluationLog.open(path, "id") as log:
            assert (log.trouble, len(log)) == (None, 1)
            assert same(log.find("jacobian", P), ARRAYS)


def test_remove_deletes_and_close_keeps(tmp_path: Path) -> None:
    log = EvaluationLog.open(tmp_path / "a", "id")
    log.close()
    assert (tmp_path / "a").exists()
    log = EvaluationLog.open(tmp_path / "a", "id")
    log.remove()
    log.remove()
    assert not (tmp_path / "a").exists()
    log.add("readings", P, ARRAYS)
    assert log.find("readings", P) is None


def test_second_run_leaves_the_log_of_the_first_alone(tmp_path: Path) -> None:
    first = EvaluationLog.open(tmp_path / "a", "id")
    second = EvaluationLog.open(tmp_path / "a", "other")
    assert second.trouble is not None
    assert "another run is using it" in second.trouble
    second.add("readings", P, ARRAYS)
    second.remove()
    first.add("readings", P, ARRAYS)
    first.close()
    with EvaluationLog.open(tmp_path / "a", "id") as log:
        assert len(log) == 1


def test_place_that_cannot_be_written_turns_it_off(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    for path in (tmp_path / "none" / "a", tmp_path / "file" / "a", tmp_path):
        log = EvaluationLog.open(path, "id")
        assert log.trouble is not None
        assert log.trouble.startswith(f"{path}: no checkpoint is kept: ")
        log.add("readings", P, ARRAYS)
        assert log.find("readings", P) is None
        log.remove()


def test_full_disk_at_the_start_turns_it_off() -> None:
    log = EvaluationLog.open("/dev/full", "id")
    assert log.trouble is not None
    log.close()


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EIO, errno.EROFS])
def test_full_disk_later_turns_it_off_and_keeps_what_is_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, number: int
) -> None:
    path = tmp_path / "a"
    sizes = filled(path, 1)
    log = EvaluationLog.open(path, "id")

    def half(file: checkpoint.io.FileIO, place: int, data: bytes) -> None:
        file.seek(place)
        file.write(data[: len(data) // 2])
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr(checkpoint, "_write", half)
    log.add("jacobian", P + 1, ARRAYS)
    assert log.trouble == f"{path}: no checkpoint is kept: {os.strerror(number)}"
    assert path.stat().st_size == sizes[1]
    log.remove()
    assert not path.exists()


WRITER = """
import sys
import numpy as np
from geoident.io.result.checkpoint import EvaluationLog
log = EvaluationLog.open(sys.argv[1], "id")
print("ready", flush=True)
for number in range(len(log), 10**9):
    log.add("jacobian", np.array([float(number)]), {"x": np.full(2000, float(number))})
    print(number, flush=True)
"""


def kill_a_writer(path: Path, delay: float) -> int:
    """Number of evaluations that the writer said it had stored."""
    command = [sys.executable, "-c", WRITER, str(path)]
    with subprocess.Popen(command, stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        process.stdout.readline()
        time.sleep(delay)
        process.kill()
        rows = process.stdout.read().split(b"\n")[:-1]
    return int(rows[-1]) + 1 if rows else 0


def check_kills(path: Path, delays: list[float]) -> None:
    for delay in delays:
        said = kill_a_writer(path, delay)
        with EvaluationLog.open(path, "id") as log:
            assert log.trouble is None
            assert len(log) >= said
            for number in range(len(log)):
                found = log.find("jacobian", np.array([float(number)]))
                assert same(found, {"x": np.full(2000, float(number))})


def test_kill_loses_nothing_that_was_stored(tmp_path: Path) -> None:
    check_kills(tmp_path / "a", [0.011])


@pytest.mark.slow
def test_kill_loses_nothing_that_was_stored_many_times(tmp_path: Path) -> None:
    check_kills(tmp_path / "a", np.random.default_rng(0).uniform(0, 0.1, 60).tolist())
