"""What imports make for others, and what a process of ours does without.

scipy makes a copy of all names of numpy, and with them of numpy's compiler of Fortran and of its
tools for tests, which import 60 modules more: a sixteenth of all that a command imports. In
processes of our own (the command line, its workers) these modules are imported when something
takes a name from them, by Python's own means (`importlib.util.LazyLoader`).

Python writes and compiles six methods for each dataclass, most of which no command calls: a
quarter of what is left. In these processes a method is compiled when it is first called.

The search for garbage looks through all that was imported before, again and again, and imports
leave none. The Python interface leaves all three as its caller has them.
"""

from __future__ import annotations

import dataclasses
import gc
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from importlib.machinery import ModuleSpec, PathFinder
from importlib.util import LazyLoader
from types import ModuleType
from typing import Any

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


_MAKER = "_create_fn"
"""What compiles a method in `dataclasses`; later versions compile those of a class together."""


def _made_when_called(create: Callable[..., Any]) -> Callable[..., Any]:
    """The same maker of methods, whose methods are made when they are first called.

    Until then they tell nobody which arguments they take: the help text that Python writes of a
    class without one of its own says so.

    Args:
        create: makes a method at once, of its name and of its text.
    """

    def later(name: str, *said: Any, **given: Any) -> Any:
        made: list[Any] = []

        def method(*args: Any, **named: Any) -> Any:
            if not made:
                real = create(name, *said, **given)
                real.__qualname__ = method.__qualname__
                made.append(real)
                for owner in type(args[0]).__mro__ if args else ():
                    if vars(owner).get(name) is method:
                        type.__setattr__(owner, name, real)  # no class is asked: all of it is here
            return made[0](*args, **named)

        method.__name__ = name
        return method

    later.__wrapped__ = create  # type: ignore[attr-defined]
    return later


def spare_imports() -> None:
    """Put off what nothing of ours needs, for the rest of this process."""
    if not any(isinstance(finder, _WhenTouched) for finder in sys.meta_path):
        sys.meta_path.insert(0, _WhenTouched())
    create = getattr(dataclasses, _MAKER, None)
    if create is not None and not hasattr(create, "__wrapped__"):
        setattr(dataclasses, _MAKER, _made_when_called(create))


@contextmanager
def without_search() -> Iterator[None]:
    """Meanwhile nobody looks for garbage, and never among what is there at the end: imports."""
    was_on = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        gc.freeze()
        if was_on:
            gc.enable()
