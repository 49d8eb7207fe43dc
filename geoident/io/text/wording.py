"""Words that messages about input share."""

from __future__ import annotations

import difflib
from collections.abc import Iterable

_SHOWN = 20
_COMPARED = 1000


class Refusal(ValueError):
    """A value that is refused, with the code, message and hint of the fault to be.

    Args:
        code: short stable name of the kind of fault.
        message: what was found and what is expected.
        hint: the likely remedy.
    """

    def __init__(self, code: str, message: str, hint: str = "") -> None:
        self.code = code
        self.message = message
        self.hint = hint
        super().__init__(message)


def did_you_mean(word: str, known: Iterable[str], *, what: str = "Known") -> str:
    """A hint that names the known word nearest to a wrong one, or lists the known words.

    Args:
        word: the wrong one.
        known: the right ones.
        what: what the known words are, the head of a list of them.

    >>> did_you_mean("bench1", ["heading", "bench 1"])
    "Did you mean 'bench 1'?"
    >>> did_you_mean("xyz", ["heading", "bench 1"], what="Stages")
    'Stages: heading, bench 1.'
    """
    known = list(known)
    near = nearest(word, known)
    return f"Did you mean '{near}'?" if near else f"{what}: {listing(known)}."


def nearest(word: str, known: Iterable[str]) -> str:
    """The known word that was probably meant by another one; empty if none is near.

    >>> nearest("fti", ["fit", "show"]), nearest("tiltmeter", ["tilt", "inclinometer"])
    ('fit', 'tilt')
    """
    folded = {name.lower(): name for name in known}
    meant = OTHER_WORDS.get(word.lower())
    if meant in folded:
        return folded[meant]
    compared = folded if len(folded) <= _COMPARED else ()
    near = difflib.get_close_matches(word.lower()[:100], compared, n=1, cutoff=0.6)
    return folded[near[0]] if near else ""


OTHER_WORDS = {
    "2d": "plane-strain",
    "3d": "solid",
    "anchor-cell": "load-cell",
    "c": "cohesion",
    "c'": "cohesion",
    "conv": "convergence",
    "crackmeter": "convergence",
    "comment": "remarks",
    "cu": "strength",
    "dilatancy": "dilation",
    "distometer": "convergence",
    "earth-pressure-cell": "pressure-cell",
    "insar": "line-of-sight",
    "instrument": "gauge",
    "jointmeter": "convergence",
    "level": "levelling",
    "logarithmic": "log",
    "pendulum": "displacement",
    "phi": "friction",
    "phi'": "friction",
    "poisson": "nu",
    "phase": "stage",
    "pore-pressure": "piezometer",
    "prism": "target",
    "psi": "dilation",
    "reading": "value",
    "rho": "density",
    "sensor": "gauge",
    "sigma_ci": "sigci",
    "sigma_v": "vertical",
    "strain-gauge": "strain",
    "su": "strength",
    "tape-extensometer": "convergence",
    "tensile": "tension",
    "tensile_strength": "tension",
    "thermocouple": "thermometer",
    "tiltmeter": "tilt",
    "ucs": "sigci",
    "young": "e",
}
"""What people call things and keys that go by another name here; all in small letters."""


def listing(names: Iterable[str]) -> str:
    """Names for a message, not more than twenty."""
    names = list(names)
    more = f" and {len(names) - _SHOWN} more" if len(names) > _SHOWN else ""
    return ", ".join(names[:_SHOWN]) + more if names else "none"


def shorten(text: object, *, width: int = 60) -> str:
    """A text on one line, cut where it is long."""
    line = " ".join(str(text).split())
    return line if len(line) <= width else f"{line[: width - 3]}..."
