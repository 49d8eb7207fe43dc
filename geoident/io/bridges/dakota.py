"""The files in which Dakota asks for an evaluation, and is answered.

Parameters come in Dakota's standard format or in that for APREPRO; results go back in the standard
format, as lines of value and label, then gradients in brackets (Dakota User's Manual, 6.24:
parameters file data format, results file data format, failure capturing).
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

from geoident.errors import Fault, InputError, Location
from geoident.io.bridges.values import WrittenValue
from geoident.io.text.text_file import decode, read_bytes
from geoident.io.text.wording import shorten
from geoident.model.arrays import Floats
from geoident.model.parameter import Parameter
from geoident.units import size_in

_MAX_BYTES = 50_000_000
VALUE, GRADIENT, HESSIAN = 1, 2, 4
"""What is asked for of a response, added up."""
_APREPRO = re.compile(r"\s*\{\s*(?P<name>\S+)\s*=\s*(?P<number>.*?)\s*\}\s*")
_STANDARD = re.compile(r"\s*(?P<number>\S+)\s+(?P<name>\S+)\s*")
_COUNT = re.compile("[0-9]{1,9}")
_BLOCKS = {
    "variables": "DAKOTA_VARS",
    "functions": "DAKOTA_FNS",
    "derivative_variables": "DAKOTA_DER_VARS",
}
"""Blocks of a file of parameters, as the first line of each is called in either format."""


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
    """A line of the file: a number and what it is called, each with its place."""

    text: str
    name: str
    text_place: Location
    name_place: Location


def read_request(path: str) -> DakotaRequest:
    """What Dakota asks for.

    Args:
        path: of its file of parameters.

    Raises:
        InputError: the file is not one, is cut short, or asks for what geoident does not have.
    """
    text = decode(read_bytes(path, limit=_MAX_BYTES, what="file of parameters"), path)
    lines = enumerate(text.splitlines(), 1)
    entries = [_entry(line, Location(path, n, 1)) for n, line in lines if line.strip()]
    blocks: dict[str, list[_Entry]] = {}
    for kind in _BLOCKS:
        blocks[kind], entries = _block(kind, entries, path)
    asked, faults = list[AskedResponse](), list[Fault]()
    for one in blocks["functions"]:
        name, parts = one.name.partition(":")[2], -1
        if _COUNT.fullmatch(one.text):
            parts = int(one.text)
        if not 0 <= parts <= VALUE + GRADIENT + HESSIAN:
            message = f"'{shorten(one.text)}' is not an entry of the active set vector"
            hint = "It is a sum of 1, 2 and 4."
            faults.append(Fault("bad-request", message, hint, one.text_place))
        elif parts & HESSIAN:
            message = f"second derivatives (a Hessian) of '{name}' are requested"
            hint = "geoident has values and gradients: write no_hessians or quasi_hessians."
            faults.append(Fault("no-hessian", message, hint, one.text_place))
        asked.append(AskedResponse(name, parts, one.name_place))
    for one in entries:
        if one.name.lower().removeprefix("dakota_") == "metadata" and one.text != "0":
            message = f"{one.text} values of metadata are requested, and geoident has none"
            hint = "Leave out 'metadata' in responses."
            faults.append(Fault("no-metadata", message, hint, one.text_place))
    if faults:
        raise InputError(faults)
    return DakotaRequest(
        values=tuple(
            WrittenValue(
                one.name,
                one.text.strip("\"'"),
                None,
                one.name_place,
                one.text_place,
                one.name_place,
            )
            for one in blocks["variables"]
        ),
        asked=tuple(asked),
        by=tuple((e.name.partition(":")[2], e.name_place) for e in blocks["derivative_variables"]),
    )


def _entry(line: str, place: Location) -> _Entry:
    match = _APREPRO.fullmatch(line) or _STANDARD.fullmatch(line)
    if match is None:
        begin = len(line) - len(line.lstrip()) + 1
        message = f"'{shorten(line)}' is not a line of a parameter file of Dakota"
        hint = "Each line is a number and its name, or '{ NAME = NUMBER }'."
        raise InputError(
            [Fault("bad-line", message, hint, Location(place.file, place.line, begin))]
        )
    places = (Location(place.file, place.line, match.start(k) + 1) for k in ("number", "name"))
    return _Entry(match["number"], match["name"], *places)


def _block(kind: str, entries: list[_Entry], path: str) -> tuple[list[_Entry], list[_Entry]]:
    """The entries of a block, whose first line is their number, and those behind it."""
    expected = f"the number of {kind.replace('_', ' ')}"
    if not entries:
        message = f"the file ends where {expected} is expected"
        raise InputError([Fault("cut-short", message, "", Location(path))])
    head, *rest = entries
    if head.name not in (_BLOCKS[kind], kind) or not _COUNT.fullmatch(head.text):
        message = f"found '{shorten(head.text)} {shorten(head.name)}'; expected {expected}"
        hint = "Is this the file of parameters that Dakota writes (standard or aprepro)?"
        raise InputError([Fault("bad-line", message, hint, head.text_place)])
    n = int(head.text)
    if len(rest) < n:
        message = f"the file ends after {len(rest)} of {head.text} {kind}"
        raise InputError([Fault("cut-short", message, "", Location(path))])
    return rest[:n], rest[n:]


def results_text(asked: Sequence[AskedResponse], values: Floats, gradients: Floats) -> str:
    """The file of results.

    Args:
        asked: of g responses.
        values: (g,) of them.
        gradients: (g, d) their derivatives by the variables that were asked for.
    """
    lines = [
        f"{value:.16e} {one.name}"
        for one, value in zip(asked, values, strict=True)
        if one.parts & VALUE
    ]
    lines += [
        f"[ {' '.join(f'{slope:.16e}' for slope in slopes)} ]"
        for one, slopes in zip(asked, gradients, strict=True)
        if one.parts & GRADIENT
    ]
    return "\n".join(lines) + "\n"


def failure_text(reason: str) -> str:
    """The file of results of an evaluation that has failed: Dakota looks for its first word.

    Args:
        reason: why.
    """
    return f"FAIL\n{' '.join(reason.split())}\n"


def input_text(
    stem: str, case: str, parameters: Sequence[Parameter], responses: Sequence[str]
) -> str:
    """An input file of Dakota: nonlinear least squares with exact gradients.

    Args:
        stem: its name without suffix; that of the file of readings, with suffix ``.dat``.
        case: path of the case, seen from its folder.
        parameters: of the case; variables are in the units of their starts.
        responses: descriptors, in their order.
    """
    sizes = [size_in(p.unit, p.dimension) or 1.0 for p in parameters]
    rows = [
        [float(x) / size for x in (p.start, p.lower, p.upper)]
        for p, size in zip(parameters, sizes, strict=True)
    ]
    start, lower, upper = (" ".join(repr(row[k]) for row in rows) for k in range(3))
    names = " ".join(f"'{parameter.name}'" for parameter in parameters)
    quoted = [f"'{name}'" for name in responses]
    described = "\n      ".join(" ".join(quoted[n : n + 5]) for n in range(0, len(quoted), 5))
    return f"""\
# {stem}: made by geoident
environment
  tabular_data

method
  nl2sol
    convergence_tolerance = 1e-8

variables
  continuous_design = {len(parameters)}
    descriptors {names}
    initial_point {start}
    lower_bounds {lower}
    upper_bounds {upper}

interface
  analysis_drivers = 'geoident simulate {case} -q --dakota'
    fork
      parameters_file = 'params.in'
      results_file = 'results.out'
      file_tag

responses
  calibration_terms = {len(responses)}
    descriptors
      {described}
    calibration_data_file = '{stem}.dat'
      freeform
      num_experiments = 1
      variance_type = 'scalar'
  analytic_gradients
  no_hessians
"""


def data_text(values: Sequence[float], sds: Sequence[float]) -> str:
    """The file of readings: one line of their values, and their variances.

    Args:
        values: in the units of their gauges.
        sds: their standard deviations.
    """
    return " ".join(repr(number) for number in (*values, *(sd**2 for sd in sds))) + "\n"
