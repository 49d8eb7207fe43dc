"""Where the shared library of Intel's MKL is found.

`pypardiso` brings the library and can find it, but takes a second for it, and its own interface
is for general matrices; so the places where pip and conda put the library are tried first.
"""

from __future__ import annotations

import ctypes
import os
import site
import sys
import warnings
from functools import cache
from pathlib import Path

_PLACES = ("lib/libmkl_rt.so*", "lib/libmkl_rt*.dylib", "Library/bin/mkl_rt*.dll")


@cache
def library() -> ctypes.CDLL:
    """The shared library `mkl_rt`.

    Raises:
        ImportError: it is not installed.
        OSError: it is there and does not load.
    """
    named = os.environ.get("PYPARDISO_MKL_RT")
    found = [named] if named else _installed()
    return ctypes.CDLL(found[0]) if found else _ask_pypardiso()


def _installed() -> list[str]:
    prefixes = [sys.prefix, site.USER_BASE or sys.prefix]
    return [
        str(path)
        for prefix in prefixes
        for place in _PLACES
        for path in sorted(Path(prefix).glob(place), key=lambda path: len(path.name))
    ]


def _ask_pypardiso() -> ctypes.CDLL:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        from pypardiso.pardiso_wrapper import PyPardisoSolver  # noqa: PLC0415

        mkl: ctypes.CDLL = PyPardisoSolver(mtype=2).libmkl
    return mkl
