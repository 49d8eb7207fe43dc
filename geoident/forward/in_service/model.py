"""A case with a seasonal model, before it is fitted: which readings it may explain."""

from __future__ import annotations

import numpy as np

from geoident.errors import InputError, Term
from geoident.forward.external.model import ExternalModel
from geoident.model.arrays import Floats
from geoident.model.case import Case


class SeasonalReadings(ExternalModel):
    """All gauges of a seasonal model at its one stage; it computes nothing by itself.

    Args:
        case: the case.
    """

    def __init__(self, case: Case) -> None:
        everywhere = np.ones((len(case.stages), len(case.channels)), dtype=np.bool_)
        super().__init__(case, everywhere, np.zeros(len(case.parameters), dtype=np.bool_))

    def given_readings(self, p: Floats, *, derivatives: bool, exact: bool) -> Floats:
        """Nothing: the coefficients of the gauges are no parameters of the case.

        Raises:
            InputError: always.
        """
        message = "a seasonal model has coefficients of each gauge, and no parameters to vary"
        hint = f"{Term.FIT} fits it; {Term.CONTROL} holds new readings against it."
        raise InputError([self.case.source.fault(("model",), "no-parameters", message, hint)])
