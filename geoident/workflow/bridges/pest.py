"""``geoident export CASE --format pest``: a case for PEST, PEST++ and pyEMU.

They drive ``geoident simulate CASE --values FILE -o FILE``: parameters go through a template into a
table of values, readings are found in the table that is written by instructions.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np

from geoident.io.bridges.names import plain, unique
from geoident.io.bridges.pest import (
    BOUNDS,
    PestObservation,
    control_text,
    covariance_text,
    in_logarithms,
    instruction_text,
    pest_parameter,
    template_text,
)
from geoident.model.arrays import Floats
from geoident.model.case import Case
from geoident.model.gauges import named_channels
from geoident.units import in_unit
from geoident.workflow.bridges.driven import DrivenCase, driven_case, untold

NOT_USED = "not_used"
"""Observation group of readings that take no part, and of what is only predicted."""
_REALIZATIONS = 100


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
    stem, case = plain(Path(path).stem), driven.model.case
    names = unique(plain(parameter.name) for parameter in case.parameters)
    parameters = [pest_parameter(n, p) for n, p in zip(names, case.parameters, strict=True)]
    observations = list(_observations(driven))
    noise, noise_file = _noise(driven), f"{stem}.noise.cov"
    options = {"parcov": f"{stem}.prior.cov", "obscov": noise_file}
    if noise is None:
        del options["obscov"]
    options |= {"ies_num_reals": str(_REALIZATIONS), "max_run_fail": "3"}
    later = [name for pair, name in driven.names.items() if pair not in driven.used]
    if later:
        options["forecasts"] = ",".join(later)
    prior = np.diag([one.variance for one in parameters])
    texts = {
        f"{stem}.pst": control_text(stem, driven.seen, parameters, observations, options),
        f"{stem}.tpl": template_text(parameters),
        f"{stem}.ins": instruction_text(observations),
        f"{stem}.prior.cov": covariance_text(names, prior),
    }
    if noise is not None:
        texts[noise_file] = covariance_text([driven.names[pair] for pair in driven.used], noise)
    return driven.write(texts, stem), tuple(_notes(driven, options))


def _observations(driven: DrivenCase) -> Iterator[PestObservation]:
    """All that is simulated, in its order."""
    case, readings = driven.model.case, driven.readings
    channels = {channel.name: channel for channel in case.channels}
    first = {pair: k for k, pair in reversed(list(enumerate(readings.pairs)))}
    gauges = dict.fromkeys(channel.gauge for channel in case.channels)
    groups = dict(zip(gauges, unique(map(plain, gauges)), strict=True))
    for line, ((name, stage), called) in enumerate(driven.names.items(), 2):
        used = driven.used.get((name, stage))
        k = first.get((name, stage)) if used is None else used
        unit = channels[name].unit, channels[name].dimension
        value = math.nan if k is None else in_unit(float(readings.value[k]), *unit)
        yield PestObservation(
            name=called,
            value=0.0 if math.isnan(value) else value,
            weight=0.0 if used is None else 1.0 / in_unit(float(readings.sd[used]), *unit),
            group=NOT_USED if used is None else groups[channels[name].gauge],
            channel=name,
            stage=stage,
            line=line,
        )


def _noise(driven: DrivenCase) -> Floats | None:
    """(k, k) covariance of the used readings in their units; None where they share no errors."""
    structure = driven.errors
    if not structure.columns.nnz:
        return None
    channels = {channel.name: channel for channel in driven.model.case.channels}
    owners = [channels[name] for name, _ in driven.used]
    size = np.array([1.0 / in_unit(1.0, owner.unit, owner.dimension) for owner in owners])
    shared = structure.columns.toarray() / size[:, None]
    return np.asarray(np.diag((structure.sd / size) ** 2) + shared @ shared.T)


def _notes(driven: DrivenCase, options: Mapping[str, str]) -> Iterator[str]:
    """What PEST is not told of the case, or otherwise."""
    case, readings = driven.model.case, driven.readings
    if "obscov" in options:
        yield (
            f"readings share errors: pestpp-ies draws noise with their covariance "
            f"({options['obscov']}), but weights, and so phi and pestpp-glm, know only the "
            "whole error of each reading"
        )
    yield from _notes_on_parameters(case, options)
    left_out = sum(1 for pair in readings.pairs if pair not in driven.names)
    if left_out:
        yield f"{left_out} readings at the zero of their gauge, or that cannot be, are left out"
    again = set(np.flatnonzero(readings.used).tolist()) - set(driven.used.values())
    channels = [readings.channel[k] for k in sorted(again) if readings.pairs[k] in driven.names]
    if channels:
        yield f"of several readings at one stage the first counts: {named_channels(channels)}"
    drifting = [channel.name for channel in case.channels if channel.drift is not None]
    if drifting:
        yield (
            f"{named_channels(drifting)}: drift counts to the end of the stage, not to the "
            "day of the reading"
        )
    if any(c.errors and c.errors.estimated for c in case.channels):
        yield "accuracies that a fit would estimate are those that the case states"
    yield from untold(case, "PEST")


def _notes_on_parameters(case: Case, options: Mapping[str, str]) -> Iterator[str]:
    """Priors and scales that PEST takes otherwise."""
    free = [p.name for p in case.parameters if p.prior is None]
    if free:
        yield (
            f"{_are(free)} without prior: in {options['parcov']} the bounds are "
            f"{BOUNDS:g} standard deviations apart, as PEST++ has it"
        )
    log = [p for p in case.parameters if p.prior and p.scale == "log"]
    normal = [p.name for p in log if not in_logarithms(p)]
    if normal:
        yield (
            f"{_are(normal)} searched on the logarithm by geoident, and not by PEST, whose "
            "prior would not be normal then"
        )


def _are(names: list[str]) -> str:
    return f"{', '.join(names)} {'is' if len(names) == 1 else 'are'}"
