"""Journals that come back in parts: how they are kept here."""

from geoident.workflow.executing.resumable import add_lines, add_part


def test_parts_go_where_they_belong_and_shorten_what_is_longer(tmp_path):
    file = tmp_path / "deep" / "points.checkpoint"
    add_part(file, b"0123", at=0)
    add_part(file, b"45", at=4)
    assert file.read_bytes() == b"012345"
    add_part(file, b"lost", at=7)  # the part before has not come
    assert file.read_bytes() == b"012345"
    add_part(file, b"x", at=2)  # another process has begun again
    assert file.read_bytes() == b"01x"
    add_part(tmp_path / "new.checkpoint", b"lost", at=1)
    assert not (tmp_path / "new.checkpoint").exists()


def test_of_lines_each_is_kept_once(tmp_path):
    file = tmp_path / "deep" / "log.jsonl"
    add_part(file, b"one\ntwo\none\n\n", at=99)
    add_part(file, b"two\nthree\n", at=0)
    assert file.read_bytes() == b"one\ntwo\nthree\n"
    before = file.stat().st_mtime_ns
    add_lines(file, b"three\n")
    assert file.stat().st_mtime_ns == before
