"""``geoident export CASE --format pest``: a case for PEST, PEST++ and pyEMU.

They drive ``geoident simulate CASE --values FILE -o FILE``: parameters go through a template into a
table of values, readings are found in the table that is written by instructions.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np

from geoident.forward.observed import ObservedModel
from geoident.io.bridges.commands import for_pest
from geoident.io.bridges.names import plain, reading_names, unique
from geoident.io.bridges.pest import (
    PestCase,
    PestGroup,
    PestObservation,
    PestParameter,
    control_text,
    covariance_text,
    instruction_text,
    template_text,
)
from geoident.model.arrays import Floats
from geoident.model.case import Case
from geoident.model.gauges import Channel, Reading, ReadingTable, named_channels
from geoident.model.methods import ModelErrorOptions, SquaredOptions
from geoident.model.parameter import Parameter
from geoident.units import in_unit, shown_unit, size_in
from geoident.workflow.bridges.driven import driven_case
from geoident.workflow.running.readings import error_structure, select_readings
from geoident.workflow.simulate import simulated_pairs

NOT_USED = "not_used"
"""Observation group of readings that take no part, and of what is only predicted."""
_RELATIVE = 0.01
"""Increment of a derivative, as a part of the parameter: PEST's usual one."""
_ABSOLUTE = 0.005
"""The same as a part of the way between the bounds, where these have zero between them."""
_REALIZATIONS = 100
_BOUNDS = 4.0
"""Standard deviations between the bounds of a parameter without prior, as PEST++ has it."""


def export_pest(
    path: str, *, output: str | None = None, force: bool = False
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Write the files of PEST for a case.

    Args:
        path: of the case.
        output: folder of the files; ``CASE.pest`` beside the case if None.
        force: replace files that stand there.

    Returns:
        The files, the control file first; what PEST is not told of the case, or otherwise.

    Raises:
        InputError: the case is wrong.
        UsageError: the case comes from stdin, or a path has blanks.
        OutputError: a file exists or cannot be written.
    """
    driven = driven_case(path, "PEST", output, not_taken=" \t", force=force)
    model = driven.model
    readings = select_readings(model.case, model)
    made = _PestFiles(plain(Path(path).stem), driven.seen, model, readings)
    case = made.case()
    texts = {
        f"{made.stem}.pst": control_text(case),
        case.template[0]: template_text(case.parameters),
        case.instructions[0]: instruction_text(case.observations),
        made.prior_file: covariance_text(
            [one.name for one in case.parameters], np.diag(_prior_variances(case.parameters))
        ),
    }
    if made.noise is not None:
        texts[made.noise_file] = covariance_text(*made.noise)
    return driven.write(texts, made.stem), tuple(made.notes())


class _PestFiles:
    """What PEST is told of a case.

    Args:
        stem: what the names of the files begin with.
        path: of the case, seen from their folder.
        model: of the case.
        readings: all of the case.
    """

    def __init__(self, stem: str, path: str, model: ObservedModel, readings: ReadingTable) -> None:
        self.stem, self._path = stem, path
        self._case: Case = model.case
        self._readings = readings
        self._pairs = simulated_pairs(model)
        self._names = dict(zip(self._pairs, reading_names(self._pairs), strict=True))
        self._channels = {channel.name: channel for channel in self._case.channels}
        self.prior_file, self.noise_file = f"{stem}.prior.cov", f"{stem}.noise.cov"
        used = [k for k in np.flatnonzero(readings.used) if readings.pairs[k] in self._names]
        self._used: dict[tuple[str, str], int] = {}
        self._again: list[int] = []
        for k in used:
            if self._used.setdefault(readings.pairs[k], int(k)) != k:
                self._again.append(int(k))
        self.noise = self._noise()

    def case(self) -> PestCase:
        """All that the files say."""
        names = unique(plain(parameter.name) for parameter in self._case.parameters)
        groups: dict[str, PestGroup] = {}
        parameters = tuple(
            _parameter(name, parameter, groups)
            for name, parameter in zip(names, self._case.parameters, strict=True)
        )
        values, computed = f"{self.stem}.values.csv", f"{self.stem}.computed.csv"
        return PestCase(
            command=for_pest(self._path, values, computed),
            parameters=parameters,
            groups=tuple(groups.values()),
            observations=tuple(self._observations()),
            template=(f"{self.stem}.tpl", values),
            instructions=(f"{self.stem}.ins", computed),
            options=dict(self._options()),
        )

    def _options(self) -> Iterator[tuple[str, str]]:
        yield "parcov", self.prior_file
        if self.noise is not None:
            yield "obscov", self.noise_file
        yield "ies_num_reals", str(_REALIZATIONS)
        yield "max_run_fail", "3"
        later = [self._names[pair] for pair in self._pairs if pair not in self._used]
        if later:
            yield "forecasts", ",".join(later)

    def _observations(self) -> Iterator[PestObservation]:
        first = {pair: k for k, pair in reversed(list(enumerate(self._readings.pairs)))}
        gauges = {channel.gauge: None for channel in self._case.channels}
        called = dict(zip(gauges, unique(map(plain, gauges)), strict=True))
        for line, pair in enumerate(self._pairs, 2):
            channel = self._channels[pair[0]]
            k, used = self._used.get(pair, first.get(pair)), pair in self._used
            value = math.nan if k is None else float(self._readings.value[k])
            sd = float(self._readings.sd[k]) if used and k is not None else math.inf
            yield PestObservation(
                name=self._names[pair],
                value=0.0 if math.isnan(value) else _shown(value, channel),
                weight=1.0 / _shown(sd, channel),
                group=called[channel.gauge] if used else NOT_USED,
                line=line,
                marks=row_begin(*pair),
            )

    def _noise(self) -> tuple[list[str], Floats] | None:
        """Names and covariance of the readings that are used; None where they share no errors."""
        case, rows = self._case, list(self._used.values())
        by_place = {(r.channel, r.stage): r for r in reversed(case.readings)}
        pairs = [self._readings.pairs[k] for k in rows]
        owners: list[tuple[Channel, Reading]] = [
            (self._channels[pair[0]], by_place[pair]) for pair in pairs
        ]
        structure = error_structure(owners)
        if not structure.columns.nnz:
            return None
        scale = np.array([1.0 / _shown(1.0, channel) for channel, _ in owners])
        B = structure.columns.toarray() / scale[:, None]
        covariance = np.diag((structure.sd / scale) ** 2) + B @ B.T
        return [self._names[pair] for pair in pairs], covariance

    def notes(self) -> Iterator[str]:
        """What PEST is not told of the case, or otherwise."""
        fit, parameters = self._case.fit, self._case.parameters
        if self.noise is not None:
            yield (
                f"readings share errors: pestpp-ies draws noise with their covariance "
                f"({self.noise_file}), but weights, and so phi and pestpp-glm, know only the "
                "whole error of each reading"
            )
        free = [p.name for p in parameters if p.prior is None]
        if free:
            yield (
                f"{_are(free)} without prior: in {self.prior_file} the bounds are "
                f"{_BOUNDS:g} standard deviations apart, as PEST++ has it"
            )
        normal = [p.name for p in parameters if p.prior and not _is_log(p) and p.scale == "log"]
        if normal:
            yield (
                f"{_are(normal)} searched on the logarithm by geoident, and not by PEST, whose "
                "prior would not be normal then"
            )
        left_out = sum(1 for pair in self._readings.pairs if pair not in self._names)
        if left_out:
            yield f"{left_out} readings at the zero of their gauge, or that cannot be, are left out"
        if self._again:
            pairs = [self._readings.channel[k] for k in self._again]
            yield f"of several readings at one stage the first counts: {named_channels(pairs)}"
        drifting = [c.name for c in self._case.channels if c.drift is not None]
        if drifting:
            yield (
                f"{named_channels(drifting)}: drift counts to the end of the stage, not to the "
                "day of the reading"
            )
        if any(c.errors and c.errors.estimated for c in self._case.channels):
            yield "accuracies that a fit would estimate are those that the case states"
        if not isinstance(fit.loss, SquaredOptions):
            yield "PEST weighs residuals by their squares; the robust loss of the case is left out"
        if fit.model_error != ModelErrorOptions():
            yield "the model error of the case is left out"


def _are(names: Sequence[str]) -> str:
    return f"{', '.join(names)} {'is' if len(names) == 1 else 'are'}"


def row_begin(channel: str, stage: str) -> str:
    """What the line of a reading begins with in a table of readings."""
    return ",".join(map(_cell, (channel, stage, "")))


def _cell(text: str) -> str:
    """A text as a cell of comma-separated values."""
    if not set(text) & set(',"'):
        return text
    doubled = text.replace('"', '""')
    return f'"{doubled}"'


def _shown(value: float, channel: Channel) -> float:
    return in_unit(value, channel.unit, channel.dimension)


def _is_log(parameter: Parameter) -> bool:
    """Whether PEST works on the logarithm: where the prior is normal, else as the case does."""
    if parameter.prior is not None:
        return parameter.prior.kind == "lognormal"
    return parameter.scale == "log"


def _parameter(name: str, parameter: Parameter, groups: dict[str, PestGroup]) -> PestParameter:
    """A parameter as PEST has it; its group is added to those there are."""
    size = size_in(parameter.unit, parameter.dimension) or 1.0
    start, lower, upper = (x / size for x in (parameter.start, parameter.lower, parameter.upper))
    if lower < 0.0 < upper or lower == 0.0 or upper == 0.0:
        group = PestGroup(f"of_{name}", "absolute", _ABSOLUTE * (upper - lower))
    else:
        group = PestGroup("relative", "relative", _RELATIVE)
    groups.setdefault(group.name, group)
    log, prior = _is_log(parameter), None
    if parameter.prior is not None:
        mean, sd = parameter.prior.mean / size, parameter.prior.sd / size
        start = min(max(mean, lower), upper)  # PEST++ draws its ensembles around the start
        prior = (math.log10(mean), sd / mean / math.log(10.0)) if log else (mean, sd)
    return PestParameter(
        name=name,
        called=parameter.name,
        unit=shown_unit(parameter.unit, parameter.dimension),
        log=log,
        start=start,
        lower=lower,
        upper=upper,
        group=group.name,
        prior=prior,
    )


def _prior_variances(parameters: Sequence[PestParameter]) -> list[float]:
    """Of each parameter, of its logarithm where PEST works on that; by the bounds without prior."""
    found = []
    for one in parameters:
        scale: Callable[[float], float] = math.log10 if one.log else float
        sd = (scale(one.upper) - scale(one.lower)) / _BOUNDS if one.prior is None else one.prior[1]
        found.append(sd**2)
    return found
