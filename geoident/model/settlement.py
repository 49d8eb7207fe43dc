"""Laws of the settlement of a fill on clay, as a case says them (theory 4.10)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Literal

from geoident.model.arrays import Floats
from geoident.model.parameter import Scalar

SettlementCurve = Literal["asaoka", "hyperbola", "consolidation"]
"""What a settlement law follows in time."""

SETTLEMENT_WORDS: Mapping[SettlementCurve, str] = {
    "asaoka": "settlement law: exponential in time (Asaoka 1978)",
    "hyperbola": "settlement law: hyperbola in time (Tan 1991)",
    "consolidation": "settlement law: consolidation of clay under a fill (Terzaghi, Barron)",
}


@dataclass(frozen=True)
class Fill:
    """The lifts of a fill: the load grows evenly from the beginning of each to its end.

    Args:
        begin: (k,) seconds since 1970.
        end: (k,) the same where the lift is placed at once.
        load: (1 + k,) before the first lift and after each, Pa; m where only its parts count.
    """

    begin: Floats
    end: Floats
    load: Floats


@dataclass(frozen=True)
class Drains:
    """Vertical drains.

    Args:
        c_h: n_channels of the coefficient of consolidation for horizontal flow, m2/s.
        influence: diameter of the ground that drains to one of them, m.
        diameter: of a drain, m.
        smear: diameter of the disturbed ground around it, m.
        smear_ratio: n_channels of permeability of the ground by that of the disturbed ground.
        installed: when, seconds since 1970; -inf for before the fill.
    """

    c_h: tuple[Scalar, ...]
    influence: float
    diameter: float
    smear: float
    smear_ratio: tuple[Scalar, ...]
    installed: float


@dataclass(frozen=True)
class Consolidation:
    """One-dimensional consolidation of clay under a fill.

    Args:
        fills: n_channels; several channels may stand on one.
        c_v: n_channels of the coefficient of consolidation, m2/s; empty for no vertical flow.
        path: n_channels of the longest way of the water, m; likewise.
        drains: vertical drains, or None.
        stress: n_channels of the effective stress before the fill, Pa; empty where settlement is in
            proportion to the load.
        creep: n_channels of the creep in a tenfold of time, as a part of the final settlement by
            consolidation; empty for none.
        creep_time: n_channels of the time after a lift from which on it counts, s; likewise.
    """

    fills: tuple[Fill, ...]
    c_v: tuple[Scalar, ...] = ()
    path: tuple[Scalar, ...] = ()
    drains: Drains | None = None
    stress: tuple[Scalar, ...] = ()
    creep: tuple[Scalar, ...] = ()
    creep_time: tuple[Scalar, ...] = ()

    @property
    def scalars(self) -> Iterator[Scalar]:
        """All its constants."""
        yield from (
            *self.c_v, *self.path, *self.stress, *self.creep, *self.creep_time
        )  # fmt: skip
        if self.drains is not None:
            yield from (*self.drains.c_h, *self.drains.smear_ratio)


@dataclass(frozen=True)
class SettlementLaw:
    """The settlement of a fill on clay in time.

    Args:
        curve: asaoka: S [1 - exp(-t / T)]; hyperbola: S t / (T + t), or of another shape; or by
            consolidation.
        since: from when t counts, seconds since 1970; of consolidation the first lift.
        final: n_channels of S, the settlement since then in the end, in the unit of what the gauge
            reads; of consolidation without creep.
        time: n_channels of T, s; empty for consolidation.
        shape: n_channels of m: S [1 - (1 + m t / T)^(-1 / m)] in place of the hyperbola, which has
            1; asaoka's curve is the limit of 0. Empty for none.
        times: (n_stages,) when each stage is, seconds since 1970.
        consolidation: of that curve, else None.
        until: when the settlement counts as final, seconds since 1970; inf for in the end.
        degrees: of consolidation, whose dates are asked for.
        after: dates after which the remaining settlement is asked for, seconds since 1970.
    """

    curve: SettlementCurve
    since: float
    final: tuple[Scalar, ...]
    time: tuple[Scalar, ...]
    times: Floats = field(compare=False)
    shape: tuple[Scalar, ...] = ()
    consolidation: Consolidation | None = None
    until: float = float("inf")
    degrees: tuple[float, ...] = ()
    after: tuple[float, ...] = ()

    @property
    def scalars(self) -> tuple[Scalar, ...]:
        """All its constants."""
        own = () if self.consolidation is None else tuple(self.consolidation.scalars)
        return self.final + self.time + self.shape + own

    @property
    def seen(self) -> frozenset[str]:
        """Names of the parameters of which it is made."""
        return frozenset(s.parameter for s in self.scalars if s.parameter is not None)

    @property
    def inputs(self) -> tuple[str, ...]:
        """Paths of all files that the model consists of: its fill has become numbers."""
        return ()
