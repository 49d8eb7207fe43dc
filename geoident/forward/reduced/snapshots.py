"""What a march leaves for the reduced model: states and their derivatives at one parameter vector.

They come out of a march with derivatives as they are, each derivative by its parameter in units of
the parameter's size. The motion that balances the virgin stress is forgotten by the march
(theory 2); its strain is what brought the stress from the given one to where it is.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from geoident.model.arrays import Floats


@dataclass(eq=False)
class Snapshot:
    """States 0 .. J of one march, M columns each.

    Args:
        p: (n,) parameters, SI.
        psi: (r, M) coordinates of the loads of the columns.
        strain: of every state, of its displacements, (s, n_points, M); of the virgin state that of
            the motion that balanced it.
        stress: likewise, Pa.
        observed: likewise what the channels see of the displacements, (n_channels, M).
    """

    p: Floats
    psi: Floats
    strain: list[Floats] = field(default_factory=list)
    stress: list[Floats] = field(default_factory=list)
    observed: list[Floats] = field(default_factory=list)

    @property
    def columns(self) -> int:
        """Number M."""
        return int(self.psi.shape[1])

    @property
    def last(self) -> int:
        """The last state."""
        return len(self.stress) - 1

    @property
    def entries(self) -> int:
        """Numbers that are kept."""
        return sum(part.size for kept in (self.strain, self.stress, self.observed) for part in kept)


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
