"""geoident from Python: load a case, fit it, predict from the fit, sample its posterior.

    from geoident import fit, load_case, predict, sample

The same steps as the commands, with the same files: a result of the same input is kept, one of
other input is not overwritten unless ``force`` says so. Numbers are in SI units. What is wrong is
raised as an error of `geoident.errors`, with all faults of the input.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from geoident.model.case import Case
from geoident.model.results.result import Iteration, Result
from geoident.units import DIMENSIONS
from geoident.workflow.estimating.finished import Finished
from geoident.workflow.fit import fit as run_fit
from geoident.workflow.predict import PredictRequest, plan_prediction
from geoident.workflow.predict import predict as run_prediction
from geoident.workflow.running.control import Control, Silent
from geoident.workflow.running.jobs import Request, load_inputs, plan_fit
from geoident.workflow.sample import SampleRequest, plan_sample
from geoident.workflow.sample import sample as run_sample

__all__ = ["CaseFile", "Found", "ParameterEstimate", "fit", "load_case", "predict", "sample"]

AnyPath = str | os.PathLike[str]
Progress = Callable[[Iteration], None]


@dataclass(frozen=True)
class CaseFile:
    """A case that was read and is right, as far as that can be told without its mesh.

    Args:
        path: of the file.
        overrides: texts ``path=value`` that replace values of the file.
        case: what it says, in SI units.
    """

    path: str
    overrides: tuple[str, ...]
    case: Case


@dataclass(frozen=True)
class ParameterEstimate:
    """One identified parameter, SI.

    Args:
        value: the estimate.
        sd: its standard deviation, about that of its prior where only that knows it; NaN where
            neither readings nor prior determine it.
        lower95, upper95: its 95 % interval.
        unit: the SI unit.
        at_bound: it lies on a bound.
        determined: the readings (with its prior) determine it, not the prior alone.
    """

    value: float
    sd: float
    lower95: float
    upper95: float
    unit: str
    at_bound: bool
    determined: bool


@dataclass(frozen=True)
class Found:
    """A result and where it stands.

    Args:
        result: all that was found, as arrays.
        path: of the result file.
        up_to_date: it stood there already and was not computed again.
    """

    result: Result
    path: str
    up_to_date: bool

    @property
    def converged(self) -> bool:
        """Whether the search ended as it should; ``result.reason`` says why."""
        return self.result.exit_code == 0

    @property
    def parameters(self) -> Mapping[str, ParameterEstimate]:
        """The parameters by name."""
        table = self.result.for_people.parameters
        return {
            name: ParameterEstimate(
                float(table.values[i]),
                float(table.sd[i]),
                float(table.lower95[i]),
                float(table.upper95[i]),
                DIMENSIONS[table.dimensions[i]],
                bool(table.at_bound[i]),
                bool(table.determined[i]),
            )
            for i, name in enumerate(table.names)
        }

    def readings(self, channel: str) -> Mapping[str, tuple[float, float]]:
        """Measured and computed reading of a channel, m, by the stages at which it was read.

        Raises:
            KeyError: there is no such channel.
        """
        gauges = self.result.gauges
        if channel not in gauges.channels:
            msg = f"no channel {channel!r}; there are {', '.join(gauges.channels)}"
            raise KeyError(msg)
        row = gauges.channels.index(channel)
        return {
            gauges.stages[j]: (float(gauges.measured[row, j]), float(gauges.computed[row, j]))
            for j in np.flatnonzero(np.isfinite(gauges.measured[row]))
        }


def load_case(path: AnyPath, overrides: Mapping[str, object] | None = None) -> CaseFile:
    """Read a case and its readings.

    Args:
        path: of the case.
        overrides: values in place of those of the file, such as
            ``{"parameters.E_rock.start": "20 GPa"}``.

    Raises:
        InputError: with all faults of the case.
    """
    changes = tuple(f"{key}={value}" for key, value in (overrides or {}).items())
    file = os.fspath(path)
    return CaseFile(file, changes, load_inputs(file, overrides=changes).case)


def fit(
    case: CaseFile | AnyPath,
    *,
    output: AnyPath | None = None,
    seed: int = 0,
    max_time: float | None = None,
    force: bool = False,
    fresh: bool = False,
    progress: Progress | None = None,
) -> Found:
    """Identify the parameters from the readings.

    Args:
        case: as loaded, or its path.
        output: file or existing folder of the result; beside the case if None.
        seed: of random numbers.
        max_time: seconds after which the search ends with what it has.
        force: overwrite a result of other input.
        fresh: compute again what is up to date.
        progress: is told of every iteration.

    Raises:
        InputError, ModelError, OutputError: see `geoident.errors`.
    """
    loaded = case if isinstance(case, CaseFile) else load_case(case)
    request = Request(
        case=loaded.path,
        overrides=loaded.overrides,
        output=None if output is None else os.fspath(output),
        seed=seed,
        force=force,
        fresh=fresh,
    )
    control = Control(_Telling(progress) if progress else Silent(), max_time=max_time)
    return _found(run_fit(plan_fit(request), control))


def predict(
    fitted: Found | AnyPath,
    *,
    stages: Sequence[str] = (),
    case: CaseFile | AnyPath | None = None,
    output: AnyPath | None = None,
    force: bool = False,
    fresh: bool = False,
) -> Found:
    """Predict readings, with 95 % bands, from a fit.

    Args:
        fitted: what `fit` found, or the path of its result.
        stages: those to predict; all that took no part in the fit if empty.
        case: another case, whose parameters are those of the fit.
        output: file or existing folder of the result; beside the fit if None.
        force: overwrite a prediction of other input.
        fresh: compute again what is up to date.

    Returns:
        The prediction; ``.result.prediction`` has means and bands, (n_channels, n_stages), m.

    Raises:
        InputError, ModelError, OutputError, UsageError: see `geoident.errors`.
    """
    new = case if isinstance(case, CaseFile) or case is None else load_case(case)
    request = PredictRequest(
        result=fitted.path if isinstance(fitted, Found) else os.fspath(fitted),
        stages=tuple(stages),
        case=None if new is None else new.path,
        overrides=() if new is None else new.overrides,
        output=None if output is None else os.fspath(output),
        force=force,
        fresh=fresh,
    )
    return _found(run_prediction(plan_prediction(request), Control()))


def sample(
    fitted: Found | AnyPath,
    *,
    draws: int = 10_000,
    effective: int = 1000,
    output: AnyPath | None = None,
    seed: int = 0,
    max_time: float | None = None,
    force: bool = False,
    fresh: bool = False,
) -> Found:
    """Draw parameters from their posterior, and predict readings with each draw.

    Args:
        fitted: what `fit` found, or the path of its result.
        draws: how many to write.
        effective: how many independent draws they are to be worth.
        output: file or existing folder of the result; beside the fit if None.
        seed: of random numbers.
        max_time: seconds after which sampling ends with what it has.
        force: overwrite a sample of other input.
        fresh: compute again what is up to date.

    Returns:
        The draws; ``.result.posterior`` has them as arrays, and ``arviz.from_netcdf`` opens
        ``.path``.

    Raises:
        InputError, ModelError, OutputError, UsageError: see `geoident.errors`.
    """
    request = SampleRequest(
        result=fitted.path if isinstance(fitted, Found) else os.fspath(fitted),
        draws=draws,
        effective=effective,
        output=None if output is None else os.fspath(output),
        seed=seed,
        force=force,
        fresh=fresh,
    )
    return _found(run_sample(plan_sample(request), Control(max_time=max_time)))


@dataclass(frozen=True)
class _Telling(Silent):
    """A monitor that passes iterations on."""

    progress: Progress = field(repr=False)

    def step(self, iteration: Iteration) -> None:
        """Pass it on."""
        self.progress(iteration)


def _found(finished: Finished) -> Found:
    return Found(finished.result, finished.paths[0], finished.up_to_date)
