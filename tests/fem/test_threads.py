"""One thread for the libraries while geoident computes; its own tasks take the cores."""

from __future__ import annotations

from contextlib import ExitStack

import pytest

from geoident.fem.solvers.threads import libraries, one_thread


@pytest.fixture
def two():
    """Both libraries with two threads, and a look at them."""
    before = [library.threads() for library in libraries()]
    for library in libraries():
        library.set_threads(2)
    yield lambda: {library.threads() for library in libraries()}
    for library, count in zip(libraries(), before, strict=True):
        library.set_threads(count)


def test_there_are_the_libraries_of_numpy_and_scipy():
    assert len(libraries()) == 2


def test_what_was_before_comes_back_when_the_last_has_left(two):
    first, second = ExitStack(), ExitStack()
    first.enter_context(one_thread())
    second.enter_context(one_thread())
    first.close()
    assert two() == {1}
    with one_thread():
        assert two() == {1}
    second.close()
    assert two() == {2}
    with pytest.raises(ValueError, match="lost"), one_thread():
        raise ValueError("lost")
    assert two() == {2}
