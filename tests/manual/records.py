"""Numbers of the verification manual: recorded by the tests that judge them, and compared by them.

A test that holds the program against a closed form or another program is given the fixture
``verification`` and calls it with what is exact and what was found. Each run of the test compares
these numbers with those that are kept in ``tests/manual/records``, from which the pages are made;
so the manual cannot drift from the program. ``sh tests/manual/renew verification`` runs the tests,
keeps their numbers and makes the pages.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

FOLDER = Path(__file__).parent / "records"
RENEW = "GEOIDENT_RENEW_VERIFICATION"
REMEDY = "the manual has other numbers; run: sh tests/manual/renew verification"
MOST = 9  # points of a table
SAME = 1e-4  # of the largest number


@dataclass(frozen=True)
class Record:
    """Numbers of one comparison.

    Attributes:
        test: that made them, ``tests/FILE.py::NAME``.
        x: where, numbers or words.
        exact: what is exact, SI.
        found: what geoident found there, SI.
    """

    test: str
    x: tuple[float | str, ...]
    exact: tuple[float, ...]
    found: tuple[float, ...]

    @property
    def deviation(self) -> float:
        """Largest difference in parts of the largest exact value."""
        difference = np.abs(np.subtract(self.found, self.exact)).max()
        return float(difference / np.abs(self.exact).max())


def records(entry: str) -> dict[str, Record]:
    """Variants of an entry of the manual, such as kinds of elements, to their numbers."""
    path = FOLDER / f"{entry}.json"
    if not path.exists():
        return {}
    kept = json.loads(path.read_text(encoding="utf-8"))
    return {name: Record(**{k: _tuple(v) for k, v in one.items()}) for name, one in kept.items()}


def _tuple(value: object) -> object:
    return tuple(value) if isinstance(value, list) else value


class Recorder:
    """The fixture ``verification`` of one test.

    Args:
        test: its name.
    """

    def __init__(self, test: str) -> None:
        self._test = test.partition("[")[0]

    def __call__(
        self,
        entry: str,
        variant: str,
        x: Sequence[str] | ArrayLike,
        *,
        exact: ArrayLike,
        found: ArrayLike,
    ) -> None:
        """Compare with the manual, or keep.

        Args:
            entry: of `manual.entries`.
            variant: of the comparison, such as the kind of element; empty if there is one only.
            x: (n,) places, times or the like, numbers or words.
            exact: (n,) or a number, SI.
            found: (n,) or a number, SI.

        Raises:
            AssertionError: the manual has other numbers.
        """
        new = _record(self._test, x, exact, found)
        there = records(entry)
        if os.environ.get(RENEW):
            _keep(entry, there | {variant: new})
            return
        assert variant in there, f"{entry}, {variant}: {REMEDY}"
        old = there[variant]
        assert old.test == new.test, REMEDY
        for a, b in ((old.exact, new.exact), (old.found, new.found)):
            np.testing.assert_allclose(
                b, a, rtol=0, atol=SAME * np.abs(old.exact).max(), err_msg=REMEDY
            )


def _record(test: str, x: Sequence[str] | ArrayLike, exact: ArrayLike, found: ArrayLike) -> Record:
    places = list(np.ravel(np.asarray(x, dtype=object)))
    values = np.broadcast_to(np.asarray(exact, dtype=float), len(places))
    answers = np.broadcast_to(np.asarray(found, dtype=float), len(places))
    order = range(len(places)) if isinstance(places[0], str) else np.argsort(places, kind="stable")
    chosen = [order[k] for k in np.unique(np.linspace(0, len(places) - 1, MOST).astype(int))]
    return Record(
        test,
        tuple(p if isinstance(p, str) else _digits(p) for p in (places[k] for k in chosen)),
        tuple(_digits(values[k]) for k in chosen),
        tuple(_digits(answers[k]) for k in chosen),
    )


def _digits(value: float) -> float:
    return float(f"{float(value):.6g}")


def _keep(entry: str, kept: Mapping[str, Record]) -> None:
    FOLDER.mkdir(exist_ok=True)
    text = json.dumps({name: asdict(kept[name]) for name in sorted(kept)}, indent=1)
    (FOLDER / f"{entry}.json").write_text(text + "\n", encoding="utf-8")
