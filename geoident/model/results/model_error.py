"""Model error: how far the ground may differ from its model (theory 9)."""

from __future__ import annotations

from geoident.model.arrays import Floats
from geoident.model.results.columns import Record, column


class ModelErrorTable(Record):
    """The model error of a fit.

    Args:
        kind: ``estimated`` or ``given``.
        size: eta, relative to the computed motion.
        lower95: lower end of its 95 % interval; the size itself where it is given.
        upper95: upper end, likewise.
        length: over which it is correlated, m; NaN where no gauge has a place.
        sizes: (m,) the eta that were weighed.
        weights: (m,) what residuals and prior leave of each; their sum is one.
        states: names of the J states, the virgin state first.
        steps: (k, J) what the step of each state adds to each computed reading, SI; 0 for readings
            that are not used.
        floors: (k, J) the error at eta = 1 that each reading has of a step, however little the step
            adds to it, SI.
        sentence: its size in words.
        factor: by which the readings scatter more than their stated accuracies; those of the result
            are the stated ones times it.
        factor_lower95: lower end of its 95 % interval; 1 where it was not estimated.
        factor_upper95: upper end, likewise.
        zero: error of the zeros of channels, in accuracies of a reading as it scatters, that the
            readings show; 0 where the case declares it, or none can tell.
        zero_lower95: lower end of its 95 % interval.
        zero_upper95: upper end, likewise.
        time: over which it is correlated; NaN where the errors are those of single steps.
        time_unit: of it: ``s``, or ``stages`` where these have no dates; empty where there is none.
        moments: (k,) log(1 + t / T) of the time t of each reading since its zero and this time T;
            NaN for readings that are not used. None where there is no such time.
        course: error of the course in time behind a tunnel face, which all channels share, relative
            to the computed motion; 0 for none.
    """

    kind: str
    size: float
    lower95: float
    upper95: float
    length: float
    sizes: Floats = column("eta", name="eta")
    weights: Floats = column("eta")
    states: tuple[str, ...] = column("state", name="state")
    steps: Floats = column("reading", "state")
    floors: Floats = column("reading", "state")
    sentence: str = ""
    factor: float = column(default=1.0, title="scatter")
    factor_lower95: float = column(default=1.0, title="scatter_lower95")
    factor_upper95: float = column(default=1.0, title="scatter_upper95")
    zero: float = 0.0
    zero_lower95: float = 0.0
    zero_upper95: float = 0.0
    time: float = column(default=float("nan"), optional=True)
    time_unit: str = column(default="", optional=True)
    moments: Floats | None = column("reading", default=None, optional=True)
    course: float = 0.0

    @property
    def large(self) -> bool:
        """Larger than models of ground usually are."""
        return self.lower95 > USUAL


USUAL = 0.3
"""Up to which part of the motion models of ground usually are wrong."""
