"""What a march leaves for the reduced model: states and their derivatives at one parameter vector.

They come out of a march with derivatives as they are, each derivative by its parameter in units of
the parameter's size. The motion that balances the virgin stress is forgotten by the march
(theory 2); its strain is what brought the stress from the given one to where it is.

Neither stresses nor strains of displacements are kept: in space they are fifteen times as many
numbers as the displacements. With E = sum_r c_r J_r the stresses of a material are J_r eps T_r,
summed, with T_r made of c_r and its derivatives: sigma_h = E C u_h + E_h C u, and so on.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from geoident.model.arrays import Floats

Further = tuple[tuple[int, int, float], ...]
"""A column beside a state and its derivatives: of (parameter h, column k, shift b) it bears

(E_h - b E) C u_k, the sum of all.
"""


@dataclass(eq=False)
class Snapshot:
    """States 0 .. J of one march, M columns each.

    Args:
        p: (n,) parameters, SI.
        psi: (r, M) coordinates of the loads of the columns.
        turns: material to T, (r_m, M, M), which makes the columns of its stress of those of strain.
        motion: of every state, its displacements, (n_dofs, M); none of the virgin state.
        settled: (s, n_points, M) strain of the motion that balanced the virgin stress; None: of
            none.
        observed: of every state, what the channels see of the displacements, (n_channels, M).
    """

    p: Floats
    psi: Floats
    turns: Mapping[str, Floats]
    motion: list[Floats] = field(default_factory=list)
    settled: Floats | None = None
    observed: list[Floats] = field(default_factory=list)

    @property
    def columns(self) -> int:
        """Number M."""
        return int(self.psi.shape[1])

    @property
    def last(self) -> int:
        """The last state."""
        return len(self.motion) - 1

    @property
    def entries(self) -> int:
        """Numbers that are kept."""
        settled = 0 if self.settled is None else self.settled.size
        return settled + sum(part.size for kept in (self.motion, self.observed) for part in kept)


def stress_turns(
    moduli: Mapping[str, Floats], slopes: Mapping[str, Floats], further: Sequence[Further]
) -> dict[str, Floats]:
    """Material to T (r, M, M): for a state, its derivatives, and further columns.

    Args:
        moduli: material to c, (r,).
        slopes: material to its derivatives, (r, n), by the parameters in units of their sizes.
        further: of what each further column is made.
    """
    found = {}
    for name, c in moduli.items():
        n = slopes[name].shape[1]
        T = np.einsum("r,ij->rij", c, np.eye(1 + n + len(further)))
        T[:, 0, 1 : 1 + n] += slopes[name]
        for place, parts in enumerate(further, start=1 + n):
            for h, column, shift in parts:
                T[:, column, place] += slopes[name][:, h] - shift * c
        found[name] = T
    return found


def settling_strain(stress: Floats, given: Floats, moduli: Floats, slopes: Floats) -> Floats:
    """Strain (s, q, 1 + n) that brought the given virgin stress of points to where it is.

    sigma = given + E eps, so d eps = E^-1 (d sigma - d given - dE eps).

    Args:
        stress: (s, q, 1 + n) at the end of the virgin state.
        given: (s, q, 1 + n) in-situ stress.
        moduli: E, (s, s).
        slopes: dE/dp, (s, s, n).
    """
    change = stress - given
    flexibility = np.linalg.inv(moduli)
    strain = np.tensordot(flexibility, change[..., 0], axes=1)
    rest = change[..., 1:] - np.einsum("ijn,jq->iqn", slopes, strain)
    return np.concatenate([strain[..., None], np.tensordot(flexibility, rest, axes=1)], axis=-1)
