"""The runs of a campaign of ``geoident batch`` as a table of runs: what was simulated in each.

Its file over all, ``campaign.h5``, has parameters and readings in SI with all digits. A parameter
of the case is that of the campaign of the same name, or a value of the base case that varies and
whose key has its name (``in_situ.K0`` for K0). Runs that failed are left out and named.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import h5py
import numpy as np

from geoident.errors import Fault, Location
from geoident.io.external.runs import MOST_RUNS, FoundRuns, RunColumn, RunRow, runs_of
from geoident.io.result.campaign import FORMAT
from geoident.io.result.hdf5 import TableReader, hdf5_input, refusal
from geoident.io.text.campaign_folder import JOURNAL
from geoident.io.text.overrides import parse_path
from geoident.io.text.wording import Refusal, did_you_mean, listing, shorten
from geoident.model.arrays import Floats
from geoident.model.campaign import SEED
from geoident.model.gauges import Channel
from geoident.model.parameter import Parameter
from geoident.units import UnitError, read_quantity, with_article

_SETTING = "parameters"
_NAMES = 8


@dataclass(frozen=True)
class _Campaign:
    """What the file of a campaign holds.

    Args:
        place: the file.
        name: of its folder.
        runs: that have ended.
        total: number of all its runs.
        settings: what varies to (r,) texts, as written.
        parameters: name to values (r,), SI, and dimension.
        readings: gauge and stage to values (r,), SI, and dimension.
    """

    place: Location
    name: str
    runs: tuple[RunRow, ...]
    total: int
    settings: Mapping[str, Sequence[str]]
    parameters: Mapping[str, tuple[Floats, str]]
    readings: Mapping[tuple[str, str], tuple[Floats, str]]


def read_campaign_runs(
    path: Path,
    parameters: Mapping[str, Parameter],
    channels: Sequence[Channel],
    stages: Sequence[str],
    ignore: Sequence[str],
) -> FoundRuns:
    """The runs of a campaign, and what is wrong with them.

    Args:
        path: of its file over all.
        parameters: by name, those that the model is given.
        channels: of the case.
        stages: names in their order.
        ignore: what varies and is passed over: paths, or names of parameters.

    Raises:
        InputError: it cannot be read, or is no file over all runs of a campaign of simulations.
    """
    campaign, faults = _read(path), list[Fault]()
    columns = list(_parameter_columns(campaign, parameters, ignore, faults))
    columns += _reading_columns(campaign, channels, stages, faults)
    named = frozenset(column.parameter or channels[column.at[1]].name for column in columns)
    if len(campaign.runs) > MOST_RUNS:
        message = f"found {len(campaign.runs)} runs; {MOST_RUNS} at most"
        hint = "More runs hardly help a response surface."
        faults.append(Fault("too-large", message, hint, campaign.place))
    shape = len(stages), len(channels)
    runs = runs_of(columns, campaign.runs, parameters, shape, campaign.name, faults)
    if runs is not None:
        runs = replace(runs, notes=(*runs.notes, *_notes(campaign, channels)))
    return FoundRuns(runs, named, tuple(faults))


def _read(path: Path) -> _Campaign:
    if not path.is_file() and (path.parent / JOURNAL).is_file():
        message = "the campaign has not ended: there is no such file"
        hint = "Run `geoident batch` of this campaign again: it continues where it stopped."
        raise refusal(path, "no-campaign", message, hint)
    with hdf5_input(path) as file:
        if file.attrs.get("format") != FORMAT:
            hint = "Give the folder that `geoident batch` has written, such as CAMPAIGN.batch."
            raise refusal(path, "no-campaign", "this is not the file of a campaign", hint)
        if file.attrs["command"] != "simulate":
            message = f"the campaign is of {file.attrs['command']}, which gives no readings"
            raise refusal(path, "wrong-command", message, "Make one with 'command: simulate'.")
        return _campaign(file, path)


def _campaign(file: h5py.File, path: Path) -> _Campaign:
    place = Location(str(path))
    table = TableReader(file, "runs")
    names, status = table.texts("run"), table.texts("status")
    runs = []
    for name, state, why in zip(names, status, table.texts("reason", len(names)), strict=True):
        failure = f"{state}: {why.splitlines()[0]}" if why else state
        runs.append(RunRow(name, f"the run {name}", place, "" if state == "done" else failure))
    varied, made = TableReader(file, "settings"), TableReader(file, "parameters")
    paths, own = varied.texts("path"), made.texts("parameter")
    texts = varied.array("value", "O").reshape(len(runs), len(paths)).T.tolist()
    values = made.floats("value", len(runs), len(own)).T
    readings: dict[tuple[str, str], tuple[Floats, str]] = {}
    if "readings" in file:
        gave = TableReader(file, "readings")
        places = list(zip(gave.texts("gauge"), gave.texts("stage"), strict=True))
        computed = gave.floats("value", len(runs), len(places)).T
        dimensions = gave.texts("dimension")
        readings = dict(zip(places, zip(computed, dimensions, strict=True), strict=True))
    return _Campaign(
        place=place,
        name=path.resolve().parent.name,
        runs=tuple(runs),
        total=int(file.attrs["total"]),
        settings={p: [t.decode() for t in column] for p, column in zip(paths, texts, strict=True)},
        parameters=dict(zip(own, zip(values, made.texts("dimension"), strict=True), strict=True)),
        readings=readings,
    )


def _parameter_columns(
    campaign: _Campaign,
    parameters: Mapping[str, Parameter],
    ignore: Sequence[str],
    faults: list[Fault],
) -> Iterator[RunColumn]:
    """The parameters of the case that runs were made with; what else varies is a fault."""

    def refuse(code: str, message: str, hint: str) -> None:
        faults.append(Fault(code, message, hint, campaign.place))

    known = [*campaign.settings, *campaign.parameters]
    for name in sorted(set(ignore) - set(known)):
        message = f"nothing in the campaign is called '{shorten(name)}', which 'ignore' names"
        refuse("unknown-column", message, did_you_mean(name, known, what="It has"))
    owners = {path: _owner(path) for path in campaign.settings}
    used = set[str]()
    for name, parameter in parameters.items():
        paths = [path for path, owner in owners.items() if owner == name and path not in ignore]
        others = [path for path in paths if not path.startswith(f"{_SETTING}.")]
        used.update(paths)
        if len(others) > 1:
            message = f"{listing(others)} vary, and each may be the parameter '{name}'"
            refuse("two-paths", message, "Name all but one under 'ignore' of the case.")
        elif others:
            values = _numbers(campaign, others[0], parameter, faults)
            yield RunColumn(others[0], campaign.place, values, name)
        elif name in campaign.parameters:
            values, dimension = campaign.parameters[name]
            _check_dimension(campaign, name, dimension, parameter.dimension, faults)
            yield RunColumn(name, campaign.place, values, name)
    for path, texts in campaign.settings.items():
        owner = owners[path]
        passed = {path, owner} & {*ignore, SEED} or path in used or _is_of_fits(path)
        if not passed and len(set(texts)) > 1:
            message = f"'{shorten(path)}' varies in the campaign, and no parameter of the "
            message += f"case is called '{shorten(owner or path)}'"
            hint = "Add it, or name it under 'ignore' of the case if nothing depends on it."
            refuse("hidden-parameter", message, hint)


def _owner(path: str) -> str:
    """The name of the parameter that a path of a value may stand for; empty for none."""
    try:
        keys = parse_path(path)
    except Refusal:
        return ""
    if keys[0] == _SETTING:
        return str(keys[1]) if len(keys) > 1 else ""
    return str(keys[-1])


def _is_of_fits(path: str) -> bool:
    """Whether a simulation does not depend on a value: bounds, priors, how a fit is made."""
    keys = path.split(".")
    if keys[0] == _SETTING:
        return len(keys) > 2 and keys[2].split("[")[0] in ("bounds", "prior", "scale")
    return keys[0] in ("fit", "report", "readings", "title")


def _check_dimension(
    campaign: _Campaign, name: str, theirs: str, ours: str, faults: list[Fault]
) -> None:
    """One name is of one dimension in the campaign and in the case."""
    if theirs != ours:
        message = f"'{name}' is {with_article(theirs)} in the campaign, and "
        message += f"{with_article(ours)} in the case"
        hint = "Give it the unit that it has there, or another name."
        faults.append(Fault("unit", message, hint, campaign.place))


def _numbers(campaign: _Campaign, path: str, parameter: Parameter, faults: list[Fault]) -> Floats:
    """(r,) the values of a path that varies, SI; NaN, with a fault, where they are none."""
    values = np.full(len(campaign.runs), np.nan)
    for n, (run, text) in enumerate(zip(campaign.runs, campaign.settings[path], strict=True)):
        message, hint = "it is left as in the base case", "Write its value in every run."
        try:
            if text:
                values[n] = read_quantity(text, parameter.dimension).value
                continue
        except UnitError as error:
            message, hint = error.message, error.hint
        message = f"'{shorten(path)}' of {run.called}: {message}"
        faults.append(Fault("bad-number", message, hint, campaign.place))
    return values


def _reading_columns(
    campaign: _Campaign, channels: Sequence[Channel], stages: Sequence[str], faults: list[Fault]
) -> Iterator[RunColumn]:
    """Readings of the case that the campaign has."""
    for j, channel in enumerate(channels):
        for i, stage in enumerate(stages):
            if (channel.name, stage) not in campaign.readings:
                continue
            values, dimension = campaign.readings[channel.name, stage]
            _check_dimension(campaign, channel.name, dimension, channel.dimension, faults)
            zero = channel.is_zeroed and channel.zero == stage
            label = f"{channel.name} at {stage}"
            yield RunColumn(label, campaign.place, values, "", (i, j), zero)


def _notes(campaign: _Campaign, channels: Sequence[Channel]) -> Iterator[str]:
    """What of the campaign is not there, or not taken."""
    if campaign.total > len(campaign.runs):
        yield (
            f"{len(campaign.runs)} of {campaign.total} runs of {campaign.name} have ended: "
            "`geoident batch` continues it"
        )
    own = {channel.name for channel in channels}
    others = list(dict.fromkeys(gauge for gauge, _ in campaign.readings if gauge not in own))
    if others:
        more = f" and {len(others) - _NAMES} more" if len(others) > _NAMES else ""
        are = "is not" if len(others) == 1 else "are not"
        yield f"{', '.join(others[:_NAMES])}{more} of {campaign.name} {are} in the case"
