"""What a march leaves for the reduced model: states and their derivatives at one parameter vector.

They come out of a march with derivatives as they are. The motion that balances the virgin stress
is forgotten by the march (theory 2); its strain is what brought the stress from the given one to
where it is.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from geoident.forward.march.march import March
from geoident.forward.march.stage import StageEnd
from geoident.model.arrays import Floats


@dataclass(eq=False)
class Snapshot:
    """States 0 .. J of one march with derivatives by all n parameters.

    Args:
        p: (n,) parameters, SI.
        u: of every state, displacements (n_dofs, 1 + n); of the virgin state zero.
        stress: likewise (s, n_points, 1 + n), Pa.
        observed: likewise what the channels see, (n_channels, 1 + n).
    """

    p: Floats
    u: list[Floats] = field(default_factory=list)
    stress: list[Floats] = field(default_factory=list)
    observed: list[Floats] = field(default_factory=list)

    def add(self, end: StageEnd, observed: Floats) -> None:
        """Keep one more state.

        Args:
            end: the state.
            observed: (n_channels, 1 + n) what the channels see of it.
        """
        self.u.append(end.u.copy())
        self.stress.append(end.stress.copy())
        self.observed.append(observed.copy())

    @property
    def last(self) -> int:
        """The last state."""
        return len(self.u) - 1

    @property
    def entries(self) -> int:
        """Numbers that are kept."""
        return sum(part.size for kept in (self.u, self.stress, self.observed) for part in kept)


def strain_of(march: March, snapshot: Snapshot, state: int, settled: Floats | None) -> Floats:
    """Strains (s, n_points, 1 + n) of the displacements of a state, at all points.

    Args:
        march: of the case.
        snapshot: of a march.
        state: which.
        settled: for the virgin state the strain of the motion that balanced it.
    """
    if state == 0:
        if settled is None:
            return np.zeros_like(snapshot.stress[0])
        return settled
    return march.systems.discretization.points.strain(snapshot.u[state])


def settling_strain(
    stress: Floats, given: Floats, moduli: Floats, slopes: Floats
) -> Floats:
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
    return np.concatenate(
        [strain[..., None], np.tensordot(flexibility, rest, axes=1)], axis=-1
    )
