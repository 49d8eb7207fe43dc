"""The files of PEST: control file, template, instructions, covariances.

The control file is one of version 1, which PEST, PEST++ and pyEMU read (Doherty, PEST: Model-
Independent Parameter Estimation, 2018; White et al., PEST++ Version 5, USGS Techniques and Methods
7C26, 2020). Names are those of `names`; numbers are in the units of people.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from geoident.model.arrays import Floats

_WIDTH = 26
"""Characters of a field of a template: all digits of a number."""
_TEMPLATE_MARKS = "~@#$%^"


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
        group: parameters whose derivatives are taken in the same way.
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
    group: str
    prior: tuple[float, float] | None


@dataclass(frozen=True)
class PestGroup:
    """How derivatives by the parameters of a group are taken.

    Args:
        name: of the group.
        kind: whether the increment is a part of the value, or an amount.
        increment: it.
    """

    name: str
    kind: Literal["relative", "absolute"]
    increment: float


@dataclass(frozen=True)
class PestObservation:
    """A reading as PEST has it, in the unit of its channel.

    Args:
        name: in PEST.
        value: what was read; 0 where nothing was.
        weight: the reciprocal of its standard deviation; 0 where it takes no part.
        group: name of its gauge, or of what takes no part.
        line: number of the line of the output in which the model says it, from 1.
        marks: what that line begins with.
    """

    name: str
    value: float
    weight: float
    group: str
    line: int
    marks: str


@dataclass(frozen=True)
class PestCase:
    """All that the files say.

    Args:
        command: runs the model in the folder of the files.
        parameters: in their order.
        groups: of parameters.
        observations: in the order of the output.
        template: names of the template and of the file that is made of it.
        instructions: names of each file of instructions and of the output that it reads.
        options: of PEST++, name to value.
        remarks: said at the head of the control file.
    """

    command: str
    parameters: tuple[PestParameter, ...]
    groups: tuple[PestGroup, ...]
    observations: tuple[PestObservation, ...]
    template: tuple[str, str]
    instructions: tuple[str, str]
    options: Mapping[str, str] = field(default_factory=dict)
    remarks: tuple[str, ...] = ()

    @property
    def priors(self) -> tuple[PestParameter, ...]:
        """The parameters of which something is known before."""
        return tuple(parameter for parameter in self.parameters if parameter.prior is not None)


PRIOR_GROUP = "prior"
"""Of the equations that say what is known of parameters."""


def control_text(case: PestCase) -> str:
    """The control file.

    Args:
        case: what it says.
    """
    priors = case.priors
    groups = list(dict.fromkeys(observation.group for observation in case.observations))
    groups += [PRIOR_GROUP] if priors else []
    counts = (len(case.parameters), len(case.observations), len(case.groups), len(priors))
    lines = ["pcf", *(f"# {remark}" for remark in case.remarks)]
    lines += [
        "* control data",
        "restart estimation",
        " ".join(map(str, (*counts, len(groups)))),
        "1 1 double point 1 0 0",
        "10.0 2.0 0.3 0.03 10",
        "10.0 10.0 0.001",
        "0.1",
        "30 0.005 4 4 0.005 4",
        "1 1 1",
        "* singular value decomposition",
        "1",
        f"{len(case.parameters)} 1e-12",
        "0",
        "* parameter groups",
    ]
    lines += [
        f"{group.name} {group.kind} {_number(group.increment)} 0.0 switch 2.0 parabolic"
        for group in case.groups
    ]
    lines += ["* parameter data", *(_parameter_line(parameter) for parameter in case.parameters)]
    lines += ["* observation groups", *groups, "* observation data"]
    lines += [
        f"{one.name} {_number(one.value)} {_number(one.weight)} {one.group}"
        for one in case.observations
    ]
    lines += ["* model command line", case.command, "* model input/output"]
    lines += [" ".join(case.template), " ".join(case.instructions)]
    if priors:
        lines += ["* prior information", *(_prior_line(parameter) for parameter in priors)]
    lines += [f"++{name}({value})" for name, value in case.options.items()]
    return "\n".join(lines) + "\n"


def _parameter_line(parameter: PestParameter) -> str:
    one = parameter
    transform = "log" if one.log else "none"
    limit = "factor" if one.lower > 0.0 else "relative"
    numbers = " ".join(_number(x) for x in (one.start, one.lower, one.upper))
    return f"{one.name} {transform} {limit} {numbers} {one.group} 1.0 0.0 1"


def _prior_line(parameter: PestParameter) -> str:
    """What is known of a parameter as an equation."""
    assert parameter.prior is not None
    mean, sd = parameter.prior
    left = f"log({parameter.name})" if parameter.log else parameter.name
    name = f"prior_{parameter.name}"
    return f"{name} 1.0 * {left} = {_number(mean)} {_number(1.0 / sd)} {PRIOR_GROUP}"


def _number(value: float) -> str:
    return repr(float(value))


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
    mark = _free_mark(one.marks for one in observations)
    lines, before = [f"pif {mark}"], 0
    for one in observations:
        words = one.marks.split() if one.marks.isascii() else [","] * one.marks.count(",")
        found = " ".join(f"{mark}{word}{mark}" for word in words)
        lines.append(f"l{one.line - before} {found} !{one.name}! {mark},{mark}")
        before = one.line
    return "\n".join(lines) + "\n"


def _free_mark(texts: Iterable[str]) -> str:
    """A character that is in none of some texts."""
    taken = set("".join(texts))
    return next((mark for mark in _TEMPLATE_MARKS if mark not in taken), "\\")


def covariance_text(names: Sequence[str], covariance: Floats) -> str:
    """A covariance matrix as PEST and pyEMU read it.

    Args:
        names: of the n rows.
        covariance: (n, n).
    """
    n = len(names)
    lines = [f"{n} {n} 1"]
    lines += [" ".join(f"{value:.15e}" for value in row) for row in np.asarray(covariance)]
    return "\n".join([*lines, "* row and column names", *names]) + "\n"
