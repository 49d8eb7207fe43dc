"""The runs of a campaign of ``geoident batch`` as a table of runs: what was simulated in each.

Its file over all, ``campaign.h5``, has parameters and readings in SI with all digits. A parameter
of the case is that of the campaign of the same name, or a value of the base case that varies and
whose key has its name (``in_situ.K0`` for K0). Runs that failed are left out and named.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import h5py
import numpy as np

from geoident.errors import Fault, Location
from geoident.io.external.run_checks import (
    SHOWN,
    FoundRuns,
    HeldColumn,
    ReadRuns,
    checked_runs,
    left_out_note,
    runs_held,
    too_few,
)
from geoident.io.external.run_table import MOST_RUNS
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
class _Said:
    """What a campaign says of its runs.

    Args:
        runs: their names.
        reasons: why each has failed; empty for those that have not.
        total: number of all its runs.
        paths: what varies.
        settings: (r, k) texts, as written.
        parameters: name to values (r,), SI, and dimension.
        readings: gauge and stage to values (r,), SI, and dimension.
    """

    runs: tuple[str, ...]
    reasons: tuple[str, ...]
    total: int
    paths: tuple[str, ...]
    settings: tuple[tuple[str, ...], ...]
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
    return _CampaignReader(path, _said(path), parameters, channels, stages).read(ignore)


def _said(path: Path) -> _Said:
    if not path.is_file() and (path.parent / JOURNAL).is_file():
        hint = "Run `geoident batch` of this campaign again: it goes on where it stopped."
        raise refusal(
            path, "no-campaign", "the campaign has not ended: there is no such file", hint
        )
    with hdf5_input(path) as file:
        if file.attrs.get("format") != FORMAT:
            hint = "Give the folder that `geoident batch` has written, such as CAMPAIGN.batch."
            raise refusal(path, "no-campaign", "this is not the file of a campaign", hint)
        if file.attrs["command"] != "simulate":
            message = f"the campaign is of {file.attrs['command']}, which gives no readings"
            raise refusal(path, "wrong-command", message, "Make one with 'command: simulate'.")
        return _of_file(file)


def _of_file(file: h5py.File) -> _Said:
    table = TableReader(file, "runs")
    runs, status = table.texts("run"), table.texts("status")
    reasons = [
        "" if state == "done" else f"{state}: {why.splitlines()[0]}" if why else state
        for state, why in zip(status, table.texts("reason", len(runs)), strict=True)
    ]
    settings = TableReader(file, "settings")
    paths = settings.texts("path")
    written = settings.array("value", "O").reshape(len(runs), len(paths)).tolist()
    own = TableReader(file, "parameters")
    names = own.texts("parameter")
    values = own.floats("value", len(runs), len(names))
    made = dict(zip(names, zip(values.T, own.texts("dimension"), strict=True), strict=True))
    readings: dict[tuple[str, str], tuple[Floats, str]] = {}
    if "readings" in file:
        gave = TableReader(file, "readings")
        places = list(zip(gave.texts("gauge"), gave.texts("stage"), strict=True))
        found = gave.floats("value", len(runs), len(places))
        readings = dict(
            zip(places, zip(found.T, gave.texts("dimension"), strict=True), strict=True)
        )
    return _Said(
        runs,
        tuple(reasons),
        int(file.attrs["total"]),
        paths,
        tuple(tuple(cell.decode() for cell in row) for row in written),
        made,
        readings,
    )


class _CampaignReader:
    def __init__(
        self,
        path: Path,
        said: _Said,
        parameters: Mapping[str, Parameter],
        channels: Sequence[Channel],
        stages: Sequence[str],
    ) -> None:
        self.path, self.said, self.faults = path, said, list[Fault]()
        self.parameters, self.channels, self.stages = parameters, channels, stages
        self.name = path.resolve().parent.name

    def read(self, ignore: Sequence[str]) -> FoundRuns:
        """What the campaign holds for the case."""
        columns = [*self._parameters(ignore), *self._readings()]
        named = frozenset(one.parameter or self.channels[one.place[1]].name for one, _ in columns)
        if len(self.said.runs) > MOST_RUNS:
            message = f"found {len(self.said.runs)} runs; {MOST_RUNS} at most"
            self._refuse("too-large", message, "More runs hardly help a response surface.")
        return FoundRuns(self._runs(columns), named, tuple(self.faults))

    def _refuse(self, code: str, message: str, hint: str = "") -> None:
        self.faults.append(Fault(code, message, hint, Location(str(self.path))))

    def _parameters(self, ignore: Sequence[str]) -> Iterator[tuple[HeldColumn, Floats]]:
        """The parameters of the case that runs were made with; what else varies is a fault."""
        said, used = self.said, set[str]()
        varied = {path: self._column(k) for k, path in enumerate(said.paths)}
        known = [*said.paths, *said.parameters]
        for name in sorted(set(ignore) - set(known)):
            message = f"nothing in the campaign is called '{shorten(name)}', which 'ignore' names"
            self._refuse("unknown-column", message, did_you_mean(name, known, what="It has"))
        owner = {path: self._owner(path) for path in said.paths}
        for name, parameter in self.parameters.items():
            paths = [p for p, one in owner.items() if one == name and p not in ignore]
            others = [p for p in paths if not p.startswith(f"{_SETTING}.")]
            used.update(paths)
            if len(others) > 1:
                message = f"{listing(others)} vary, and each may be the parameter '{name}'"
                self._refuse("two-paths", message, "Name all but one under 'ignore' of the case.")
            elif others:
                yield HeldColumn(others[0], name), self._numbers(others[0], parameter)
            elif name in said.parameters:
                values, dimension = said.parameters[name]
                self._same(name, dimension, parameter.dimension)
                yield HeldColumn(name, name), values
        for path, texts in varied.items():
            idle = path in used or path in ignore or owner[path] in ignore
            if not (idle or len(set(texts)) == 1 or path == SEED or self._is_aside(path)):
                name = owner[path] or path
                message = f"'{shorten(path)}' varies in the campaign, and no parameter of the "
                message += f"case is called '{shorten(name)}'"
                hint = "Add it, or name it under 'ignore' of the case if nothing depends on it."
                self._refuse("hidden-parameter", message, hint)

    def _column(self, k: int) -> list[str]:
        return [row[k] for row in self.said.settings]

    @staticmethod
    def _owner(path: str) -> str:
        """The name of the parameter that a path of a value may stand for; empty for none."""
        try:
            keys = parse_path(path)
        except Refusal:
            return ""
        if keys[0] == _SETTING:
            return str(keys[1]) if len(keys) > 1 else ""
        return str(keys[-1])

    @staticmethod
    def _is_aside(path: str) -> bool:
        """Whether a simulation does not depend on a value: bounds, priors, how a fit is made."""
        keys = path.split(".")
        if keys[0] == _SETTING:
            return len(keys) > 2 and keys[2].split("[")[0] in ("bounds", "prior", "scale")
        return keys[0] in ("fit", "report", "readings", "title")

    def _same(self, name: str, theirs: str, ours: str) -> None:
        """One name is of one dimension in the campaign and in the case."""
        if theirs != ours:
            message = f"'{name}' is {with_article(theirs)} in the campaign, and "
            message += f"{with_article(ours)} in the case"
            self._refuse("unit", message, "Give it the unit that it has there, or another name.")

    def _numbers(self, path: str, parameter: Parameter) -> Floats:
        """(r,) the values of a path that varies, SI; NaN, with a fault, where they are none."""
        found = np.full(len(self.said.runs), np.nan)
        texts = self._column(self.said.paths.index(path))
        for n, text in enumerate(texts):
            try:
                if text:
                    found[n] = read_quantity(text, parameter.dimension).value
                    continue
                message, hint = "it is left as in the base case", "Write its value in every run."
            except UnitError as error:
                message, hint = error.message, error.hint
            run = self.said.runs[n]
            self._refuse("bad-number", f"'{shorten(path)}' of the run {run}: {message}", hint)
        return found

    def _readings(self) -> Iterator[tuple[HeldColumn, Floats]]:
        """Readings of the case that the campaign has."""
        for j, channel in enumerate(self.channels):
            for i, stage in enumerate(self.stages):
                found = self.said.readings.get((channel.name, stage))
                if found is None:
                    continue
                self._same(channel.name, found[1], channel.dimension)
                zero = channel.is_zeroed and channel.zero == stage
                label = f"{channel.name} at {stage}"
                yield HeldColumn(label, place=(i, j), zero=zero), found[0]

    def _runs(self, columns: Sequence[tuple[HeldColumn, Floats]]) -> ReadRuns | None:
        said, holds = self.said, [one for one, _ in columns]
        names = tuple(one.parameter for one in holds if one.parameter)
        if self.faults or not names or len(names) == len(holds):
            return None  # what has no column is said of the case
        table = np.column_stack([values for _, values in columns])
        failed = [n for n, reason in enumerate(said.reasons) if reason or self._lost(table[n])]
        sound = np.setdiff1d(np.arange(len(said.runs)), failed)
        wrong = too_few(len(names), len(sound), len(failed))
        if wrong is not None:
            self._refuse("too-few", *wrong)
            return None

        def refuse(at: int, code: str, message: str, hint: str) -> None:
            run = f"the run {said.runs[int(sound[at])]}: " if at >= 0 else ""
            if code == "constant-column" and holds[-1 - at].parameter:
                name = holds[-1 - at].parameter
                message = f"the parameter '{name}' is the same in all runs of the campaign"
                hint = f"Vary {_SETTING}.{name}.start there, or remove it here."
            self._refuse(code, f"{run}{message}", hint)

        called = [f"the run {said.runs[n]}" for n in sound.tolist()]
        checked_runs(holds, table[sound], called, self.parameters, refuse)
        if self.faults:
            return None
        shape = len(self.stages), len(self.channels)
        return runs_held(holds, table[sound], shape, tuple(self._notes(holds, failed, table)))

    @staticmethod
    def _lost(row: Floats) -> bool:
        return not bool(np.isfinite(row).all())

    def _notes(
        self, holds: Sequence[HeldColumn], failed: Sequence[int], table: Floats
    ) -> Iterator[str]:
        """What of the campaign is not there, or not taken."""
        said = self.said
        words = []
        for n in failed[:SHOWN]:
            lost = [one.label for one, value in zip(holds, table[n], strict=True)
                    if not np.isfinite(value)]  # fmt: skip
            words.append(f"{said.runs[n]} ({said.reasons[n] or f'{lost[0]} is missing'})")
        yield from left_out_note(words, len(failed), len(said.runs), self.name)
        if said.total > len(said.runs):
            yield (
                f"{len(said.runs)} of {said.total} runs of {self.name} have ended: "
                "`geoident batch` goes on with it"
            )
        own = {channel.name for channel in self.channels}
        others = list(dict.fromkeys(gauge for gauge, _ in said.readings if gauge not in own))
        if others:
            more = f" and {len(others) - _NAMES} more" if len(others) > _NAMES else ""
            are = "is not" if len(others) == 1 else "are not"
            yield f"{', '.join(others[:_NAMES])}{more} of {self.name} {are} in the case"
