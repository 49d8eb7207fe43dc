"""What is known, after a fit, of constants that vary from place to place (theory 10.4)."""

from __future__ import annotations

from geoident.model.arrays import Floats, Ints
from geoident.model.results.columns import Record, column


class FieldEstimate(Record):
    """A field at the elements of its material, one entry of every array each.

    Args:
        name: of the field, such as ``rock.E``.
        material: of which it is.
        constant: which one.
        dimension: key of `geoident.units.DIMENSIONS`.
        unit: in which people want to see it.
        elements: (n,) indices of the elements, ascending.
        centres: (n, dim) their centres, m.
        values: (n,) median at the estimate, SI.
        sd: (n,) standard deviation of the logarithm; NaN where the mean is not determined.
        prior_sd: (n,) the same before the readings, with the mean as it is: what tests leave.
        reduction: (n,) part of the prior variance that the readings take away, 0 to 1.
        modes: number of modes; 0 where it grows by a law: prior_sd is NaN and reduction 0 then.
        explained: part of the variance that the modes hold.
        tests: number of values that were measured.
    """

    name: str
    material: str
    constant: str
    dimension: str
    unit: str
    elements: Ints = column("element", name="element")
    centres: Floats = column("element", "axis", name="centre", dimension="length")
    values: Floats = column("element", dimension="field")
    sd: Floats = column("element")
    prior_sd: Floats = column("element")
    reduction: Floats = column("element")
    modes: int
    explained: float
    tests: int = 0
