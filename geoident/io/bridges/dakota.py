"""The files in which Dakota asks for an evaluation, and is answered.

Parameters come in Dakota's standard format or in that for APREPRO; results go back in the standard
format, as lines of value and label, then gradients in brackets (Dakota User's Manual, 6.24:
parameters file data format, results file data format, failure capturing).
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import islice

import numpy as np

from geoident.errors import Fault, InputError, Location
from geoident.io.bridges.values import WrittenValue
from geoident.io.text.text_file import decode, read_bytes
from geoident.io.text.wording import shorten
from geoident.model.arrays import Floats

_MAX_BYTES = 50_000_000
VALUE, GRADIENT, HESSIAN = 1, 2, 4
"""What is asked for of a response, added up."""
_APREPRO = re.compile(r"\{\s*(\S+)\s*=\s*(.*?)\s*\}\s*$")
_STANDARD = re.compile(r"(\S+)\s+(\S+)\s*$")
_COUNT = re.compile("[0-9]{1,9}")
_COUNTS = ("DAKOTA_VARS", "DAKOTA_FNS", "DAKOTA_DER_VARS")
_WORDS = ("variables", "functions", "derivative_variables")


@dataclass(frozen=True)
class AskedResponse:
    """What is asked for of one response.

    Args:
        name: its descriptor.
        parts: the sum of `VALUE`, `GRADIENT`, `HESSIAN`.
        place: where it stands.
    """

    name: str
    parts: int
    place: Location


@dataclass(frozen=True)
class DakotaRequest:
    """What a file of parameters says.

    Args:
        values: of the variables.
        asked: of the responses, in their order.
        by: the variables by which derivatives are wanted, in their order, and where that stands.
    """

    values: tuple[WrittenValue, ...]
    asked: tuple[AskedResponse, ...]
    by: tuple[tuple[str, Location], ...]


@dataclass(frozen=True)
class _Entry:
    """A line of the file: a number and what it is called."""

    text: str
    name: str
    number_at: Location
    name_at: Location


def read_request(path: str) -> DakotaRequest:
    """What Dakota asks for.

    Args:
        path: of its file of parameters.

    Raises:
        InputError: the file is not one, is cut short, or asks for what geoident does not have.
    """
    text = decode(read_bytes(path, limit=_MAX_BYTES, what="file of parameters"), path)
    entries = [
        _entry(line, path, number)
        for number, line in enumerate(text.splitlines(), 1)
        if line.strip()
    ]
    left = iter(entries)
    variables = _block(left, 0, path)
    values = tuple(
        WrittenValue(one.name, one.text.strip("\"'"), None, one.name_at, one.number_at, one.name_at)
        for one in variables
    )
    asked, faults = [], list[Fault]()
    for one in _block(left, 1, path):
        parts = int(one.text) if _COUNT.fullmatch(one.text) else -1
        name = one.name.partition(":")[2]
        if not 0 <= parts <= VALUE + GRADIENT + HESSIAN:
            message = f"'{shorten(one.text)}' is no entry of the active set vector"
            faults.append(
                Fault("bad-request", message, "It is a sum of 1, 2 and 4.", one.number_at)
            )
        elif parts & HESSIAN:
            message = f"second derivatives (a Hessian) of '{name}' are asked for"
            hint = "geoident has values and gradients: say no_hessians, or quasi_hessians."
            faults.append(Fault("no-hessian", message, hint, one.number_at))
        asked.append(AskedResponse(name, max(parts, 0), one.name_at))
    by = tuple((one.name.partition(":")[2], one.name_at) for one in _block(left, 2, path))
    for one in left:
        if one.name.lower().removeprefix("dakota_") == "metadata" and one.text != "0":
            message = f"{one.text} values of metadata are asked for, and geoident has none"
            faults.append(
                Fault("no-metadata", message, "Leave out 'metadata' in responses.", one.number_at)
            )
    if faults:
        raise InputError(faults)
    return DakotaRequest(values, tuple(asked), by)


def _entry(line: str, path: str, number: int) -> _Entry:
    begin = len(line) - len(line.lstrip()) + 1
    found = _APREPRO.match(line.strip())
    if found is not None:
        number_at = Location(path, number, begin + found.start(2))
        return _Entry(found[2], found[1], number_at, Location(path, number, begin + found.start(1)))
    found = _STANDARD.match(line.strip())
    if found is None:
        message = f"'{shorten(line)}' is no line of a file of parameters of Dakota"
        hint = "Each line is a number and its name, or '{ NAME = NUMBER }'."
        raise InputError([Fault("bad-line", message, hint, Location(path, number, begin))])
    name_at = Location(path, number, begin + found.start(2))
    return _Entry(found[1], found[2], Location(path, number, begin), name_at)


def _block(entries: Iterator[_Entry], kind: int, path: str) -> list[_Entry]:
    """The entries of a block, whose first line is their number."""
    head = next(entries, None)
    expected = f"the number of {_WORDS[kind].replace('_', ' ')}"
    if head is None:
        message = f"the file ends where {expected} is expected"
        raise InputError([Fault("cut-short", message, "", Location(path))])
    if head.name not in (_COUNTS[kind], _WORDS[kind]) or not _COUNT.fullmatch(head.text):
        message = f"found '{shorten(head.text)} {shorten(head.name)}'; {expected} is expected"
        hint = "Is this the file of parameters that Dakota writes (standard or aprepro)?"
        raise InputError([Fault("bad-line", message, hint, head.number_at)])
    found = list(islice(entries, int(head.text)))
    if len(found) < int(head.text):
        message = f"the file ends after {len(found)} of {head.text} {_WORDS[kind]}"
        raise InputError([Fault("cut-short", message, "", Location(path))])
    return found


def results_text(asked: Sequence[AskedResponse], values: Floats, gradients: Floats) -> str:
    """The file of results.

    Args:
        asked: of g responses.
        values: (g,) of them.
        gradients: (g, d) their derivatives by the variables that were asked for.
    """
    lines = [
        f"{_number(value)} {one.name}"
        for one, value in zip(asked, values, strict=True)
        if one.parts & VALUE
    ]
    lines += [
        f"[ {' '.join(map(_number, gradient))} ]"
        for one, gradient in zip(asked, np.atleast_2d(gradients), strict=True)
        if one.parts & GRADIENT
    ]
    return "\n".join(lines) + "\n"


def _number(value: float) -> str:
    assert math.isfinite(value)
    return f"{value:.16e}"


def failure_text(reason: str) -> str:
    """The file of results of an evaluation that has failed: Dakota looks for its first word.

    Args:
        reason: why.
    """
    return f"FAIL\n{' '.join(reason.split())}\n"


@dataclass(frozen=True)
class DakotaVariable:
    """A variable, in the unit in which the case gives its start.

    Args:
        name: descriptor.
        start: initial point.
        lower: lower bound.
        upper: upper bound.
    """

    name: str
    start: float
    lower: float
    upper: float


@dataclass(frozen=True)
class DakotaInput:
    """What an input file says.

    Args:
        title: remark in its first line.
        driver: command to which Dakota adds the names of both files.
        variables: in their order.
        responses: descriptors, in their order.
        data: name of the file of readings.
    """

    title: str
    driver: str
    variables: tuple[DakotaVariable, ...]
    responses: tuple[str, ...]
    data: str


def input_text(deck: DakotaInput) -> str:
    """An input file of Dakota: nonlinear least squares with exact gradients.

    Args:
        deck: what it says.
    """

    def column(values: Sequence[float]) -> str:
        return " ".join(repr(float(value)) for value in values)

    names = " ".join(f"'{variable.name}'" for variable in deck.variables)
    quoted = [f"'{name}'" for name in deck.responses]
    rows = [" ".join(quoted[n : n + 5]) for n in range(0, len(quoted), 5)]
    described = "\n      ".join(rows)
    return f"""\
# {deck.title}
environment
  tabular_data

method
  nl2sol
    convergence_tolerance = 1e-8

variables
  continuous_design = {len(deck.variables)}
    descriptors {names}
    initial_point {column([variable.start for variable in deck.variables])}
    lower_bounds {column([variable.lower for variable in deck.variables])}
    upper_bounds {column([variable.upper for variable in deck.variables])}

interface
  analysis_drivers = '{deck.driver}'
    fork
      parameters_file = 'params.in'
      results_file = 'results.out'
      file_tag

responses
  calibration_terms = {len(deck.responses)}
    descriptors
      {described}
    calibration_data_file = '{deck.data}'
      freeform
      num_experiments = 1
      variance_type = 'scalar'
  analytic_gradients
  no_hessians
"""


def data_text(values: Floats, sds: Floats) -> str:
    """The file of readings: one line of their values, and their variances.

    Args:
        values: (g,) in the units of their gauges.
        sds: (g,) their standard deviations.
    """
    return " ".join(repr(float(number)) for number in (*values, *(sds**2))) + "\n"
