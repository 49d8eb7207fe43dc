"""The files of PEST: control file, template, instructions, covariances.

The control file is one of version 1, which PEST, PEST++ and pyEMU read (Doherty, PEST: Model-
Independent Parameter Estimation, 2018; White et al., PEST++ Version 5, USGS Techniques and Methods
7C26, 2020). Names are those of `names`; numbers are in the units of people.

They are written here and not by pyEMU, which reads them in the tests: as many lines would fill its
data frames, its import takes 1.1 s, warns, and brings pandas, and export would need an extra.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass

from geoident.model.arrays import Floats
from geoident.model.parameter import Parameter
from geoident.units import shown_unit, size_in

_RELATIVE = 0.01
"""Increment of a derivative, as a part of the parameter: PEST's usual one."""
_ABSOLUTE = 0.005
"""The same as a part of the way between the bounds, where these have zero between them."""
BOUNDS = 4.0
"""Standard deviations between the bounds of a parameter without prior, as PEST++ has it."""
_WIDTH = 26
"""Characters of a field of a template: all digits of a number."""
_MARKS = "~@#$%^"
_PRIOR_GROUP = "prior"
"""Of the equations that say what is known of parameters."""
_CONTROL = """\
* control data
restart estimation
{counts}
1 1 double point 1 0 0
10.0 2.0 0.3 0.03 10
10.0 10.0 0.001
0.1
30 0.005 4 4 0.005 4
1 1 1
* singular value decomposition
1
{n} 1e-12
0"""


@dataclass(frozen=True)
class PestParameter:
    """A parameter as PEST has it, in the unit of people.

    Args:
        name: in PEST.
        called: in the case.
        unit: of its values; empty for none.
        log: PEST works on its logarithm (base 10).
        start: value to start from.
        lower: lower bound.
        upper: upper bound.
        prior: mean and standard deviation, of the logarithm (base 10) where PEST works on that;
            None for none.
    """

    name: str
    called: str
    unit: str
    log: bool
    start: float
    lower: float
    upper: float
    prior: tuple[float, float] | None

    @property
    def group(self) -> tuple[str, str, float]:
        """Name of its group, and how derivatives are taken there: kind and size of increment."""
        if self.lower <= 0.0 <= self.upper:
            return f"of_{self.name}", "absolute", _ABSOLUTE * (self.upper - self.lower)
        return "relative", "relative", _RELATIVE

    @property
    def variance(self) -> float:
        """Before the readings, of its logarithm where PEST works on that."""
        if self.prior is not None:
            return self.prior[1] ** 2
        scale: Callable[[float], float] = math.log10 if self.log else float
        return ((scale(self.upper) - scale(self.lower)) / BOUNDS) ** 2


@dataclass(frozen=True)
class PestObservation:
    """A reading as PEST has it, in the unit of its channel.

    Args:
        name: in PEST.
        value: what was read; 0 where nothing was.
        weight: the reciprocal of its standard deviation; 0 where it takes no part.
        group: name of its gauge, or of what takes no part.
        channel: of the reading.
        stage: of the reading.
        line: number of the line of the output in which the model says it, from 1.
    """

    name: str
    value: float
    weight: float
    group: str
    channel: str
    stage: str
    line: int


def in_logarithms(parameter: Parameter) -> bool:
    """Whether PEST works on the logarithm: where the prior is normal, else as the case does."""
    if parameter.prior is not None:
        return parameter.prior.kind == "lognormal"
    return parameter.scale == "log"


def pest_parameter(name: str, parameter: Parameter) -> PestParameter:
    """A parameter of a case as PEST has it.

    Args:
        name: in PEST.
        parameter: of the case.
    """
    size = size_in(parameter.unit, parameter.dimension) or 1.0
    start, lower, upper = (x / size for x in (parameter.start, parameter.lower, parameter.upper))
    log, prior = in_logarithms(parameter), None
    if parameter.prior is not None:
        mean, sd = parameter.prior.mean / size, parameter.prior.sd / size
        start = min(max(mean, lower), upper)  # PEST++ draws its ensembles around the start
        prior = (math.log10(mean), sd / mean / math.log(10.0)) if log else (mean, sd)
    unit = shown_unit(parameter.unit, parameter.dimension)
    return PestParameter(name, parameter.name, unit, log, start, lower, upper, prior)


def control_text(
    stem: str,
    case: str,
    parameters: Sequence[PestParameter],
    observations: Sequence[PestObservation],
    options: Mapping[str, str],
) -> str:
    """The control file; all its files are named after it.

    Args:
        stem: its name without suffix.
        case: path of the case, seen from its folder.
        parameters: in their order.
        observations: in the order of the output.
        options: of PEST++, name to value.
    """
    priors = [one for one in parameters if one.prior is not None]
    of_parameters = list(dict.fromkeys(one.group for one in parameters))
    groups = list(dict.fromkeys(one.group for one in observations))
    groups += [_PRIOR_GROUP] if priors else []
    counts = len(parameters), len(observations), len(of_parameters), len(priors), len(groups)
    values, computed = f"{stem}.values.csv", f"{stem}.computed.csv"
    lines = ["pcf", _CONTROL.format(counts=" ".join(map(str, counts)), n=len(parameters))]
    lines += ["* parameter groups"]
    lines += [
        f"{name} {kind} {step!r} 0.0 switch 2.0 parabolic" for name, kind, step in of_parameters
    ]
    lines += ["* parameter data"]
    for one in parameters:
        transform, limit = "log" if one.log else "none", "factor" if one.lower > 0.0 else "relative"
        numbers = " ".join(repr(float(x)) for x in (one.start, one.lower, one.upper))
        lines.append(f"{one.name} {transform} {limit} {numbers} {one.group[0]} 1.0 0.0 1")
    lines += ["* observation groups", *groups, "* observation data"]
    lines += [f"{o.name} {float(o.value)!r} {float(o.weight)!r} {o.group}" for o in observations]
    lines += ["* model command line"]
    lines += [f"geoident simulate {case} --values {values} -o {computed} --force -q"]
    lines += ["* model input/output", f"{stem}.tpl {values}", f"{stem}.ins {computed}"]
    lines += ["* prior information"] if priors else []
    for one in priors:
        mean, sd = one.prior or (0.0, 1.0)
        left = f"log({one.name})" if one.log else one.name
        equation = f"1.0 * {left} = {float(mean)!r} {1.0 / float(sd)!r}"
        lines.append(f"prior_{one.name} {equation} {_PRIOR_GROUP}")
    lines += [f"++{name}({value})" for name, value in options.items()]
    return "\n".join(lines) + "\n"


def template_text(parameters: Sequence[PestParameter]) -> str:
    """The template of a table of values that ``geoident simulate --values`` reads.

    Args:
        parameters: in their order.
    """
    mark = _free_mark(f"{one.name}{one.called}{one.unit}" for one in parameters)
    lines = [f"ptf {mark}", "parameter,value,unit"]
    lines += [
        f"{one.called},{mark}{one.name:^{max(_WIDTH, len(one.name)) - 2}}{mark},{one.unit}"
        for one in parameters
    ]
    return "\n".join(lines) + "\n"


def instruction_text(observations: Sequence[PestObservation]) -> str:
    """The instructions that find readings in what ``geoident simulate -o`` writes.

    A reading is the cell after its gauge and stage, which are looked for in its line. PEST++ takes
    no blanks in what is looked for, so that their words are looked for one after the other.

    Args:
        observations: in the order of their lines.
    """
    begins = [",".join(map(_csv_cell, (one.channel, one.stage, ""))) for one in observations]
    mark = _free_mark(begins)
    lines, before = [f"pif {mark}"], 0
    for one, begin in zip(observations, begins, strict=True):
        words = begin.split() if begin.isascii() else [","] * begin.count(",")
        marked = " ".join(f"{mark}{word}{mark}" for word in words)
        lines.append(f"l{one.line - before} {marked} !{one.name}! {mark},{mark}")
        before = one.line
    return "\n".join(lines) + "\n"


def _csv_cell(text: str) -> str:
    """A text as a cell of comma-separated values."""
    if not set(text) & set(',"'):
        return text
    doubled = text.replace('"', '""')
    return f'"{doubled}"'


def _free_mark(texts: Iterable[str]) -> str:
    """A character that is in none of some texts."""
    taken = set("".join(texts))
    return next((mark for mark in _MARKS if mark not in taken), "\\")


def covariance_text(names: Sequence[str], covariance: Floats) -> str:
    """A covariance matrix as PEST and pyEMU read it.

    Args:
        names: of the n rows.
        covariance: (n, n).
    """
    lines = [f"{len(names)} {len(names)} 1"]
    lines += [" ".join(f"{value:.15e}" for value in row) for row in covariance]
    return "\n".join([*lines, "* row and column names", *names]) + "\n"
