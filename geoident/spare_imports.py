"""Imports that libraries make for others, and that a process of ours does without.

scipy makes a copy of all names of numpy, and with them of numpy's compiler of Fortran and of its
tools for tests, which import 60 modules more: a sixteenth of all that a command imports. In
processes of our own (the command line, its workers) these modules are imported when something
takes a name from them, by Python's own means (`importlib.util.LazyLoader`). The Python interface
leaves the imports of its caller as they are.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from importlib.machinery import ModuleSpec, PathFinder
from importlib.util import LazyLoader
from types import ModuleType

SPARED = frozenset({"numpy.f2py", "numpy.testing"})
"""Modules that are imported when something is taken from them. Nothing takes anything from these
in threads: two that did so at a time could see a module half made (Python before 3.12)."""


class _WhenTouched:
    """Finds the spared modules as Python does, and puts their import off."""

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """The module, to be executed when touched; None for all that are not spared.

        Args:
            fullname: of the module.
            path: where its package is.
            target: the module that is reloaded, if one is.
        """
        if fullname not in SPARED:
            return None
        found = PathFinder.find_spec(fullname, path, target)
        if found is not None and found.loader is not None:
            found.loader = LazyLoader(found.loader)
        return found


def spare_imports() -> None:
    """Put off the imports that nothing of ours needs, for the rest of this process."""
    if not any(isinstance(finder, _WhenTouched) for finder in sys.meta_path):
        sys.meta_path.insert(0, _WhenTouched())
