"""One thread for the libraries while geoident computes; its own tasks take the cores."""

from __future__ import annotations

from contextlib import ExitStack

import pytest
import scipy.linalg  # noqa: F401 - brings the library of scipy
from threadpoolctl import ThreadpoolController

from geoident.fem.solvers.threads import one_thread


@pytest.fixture
def threads():
    """Numbers of threads of the libraries of numpy and scipy, which are allowed two."""
    libraries = ThreadpoolController().select(user_api="blas")

    def numbers():
        ours = [one for one in libraries.info() if "scipy_openblas" in one["filepath"]]
        return {library["num_threads"] for library in ours}

    with libraries.limit(limits=2):
        if not numbers():
            pytest.skip("numpy and scipy come without OpenBLAS here: install their wheels")
        yield numbers


def test_what_was_before_comes_back_when_the_last_has_left(threads):
    first, second = ExitStack(), ExitStack()
    assert threads() == {2}
    first.enter_context(one_thread())
    second.enter_context(one_thread())
    first.close()
    assert threads() == {1}
    with one_thread():
        assert threads() == {1}
    second.close()
    assert threads() == {2}
    with pytest.raises(ValueError, match="lost"), one_thread():
        raise ValueError("lost")
    assert threads() == {2}
