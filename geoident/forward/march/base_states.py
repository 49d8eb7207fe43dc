"""What the march keeps of states on which later ones build."""

from __future__ import annotations

from collections.abc import Sequence

from geoident.forward.march.state import Borne
from geoident.forward.stages import State
from geoident.model.arrays import Floats


class Branches:
    """Keeps what later states build on, as long as they need it, and no longer."""

    def __init__(self, states: Sequence[State]) -> None:
        self._bases = [state.base for state in states]
        self._last_use = {base: n for n, base in enumerate(self._bases) if base != n - 1}
        self._kept: dict[int, tuple[Floats, Borne]] = {}

    def go_to(self, state: int, u: Floats, borne: Borne) -> None:
        """Put the displacements and stresses in place on which a state builds."""
        base = self._bases[state]
        if base == state - 1 or state == 0:
            return
        u[:], kept = self._kept[base]
        borne.restore(kept)
        if self._last_use[base] == state:
            del self._kept[base]

    def leave(self, state: int, u: Floats, borne: Borne) -> None:
        """Copy them where a later state builds on this one, but not the next."""
        if self._last_use.get(state, -1) > state:
            self._kept[state] = u.copy(), borne.copy()
