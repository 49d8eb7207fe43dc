"""Whether the cases of the runs of a campaign are right, before anything is computed."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace

from geoident.errors import Fault, InputError
from geoident.io.case.file import parse_case
from geoident.model.campaign import Campaign
from geoident.model.run import Run, varied_paths
from geoident.workflow.running.jobs import NO_READINGS
from geoident.workflow.running.run_table import in_order, placed

_MOST = 50
"""Runs whose cases are read before anything is computed."""

_OF_PATHS = ("bad-override", "unknown-key")
"""Faults that do not depend on the value."""


def require_right_cases(campaign: Campaign, runs: Sequence[Run], text: str) -> None:
    """Read the base case and the cases of some runs, so that a wrong value is known at once.

    Args:
        campaign: with the base case.
        runs: that are to be computed; nothing is read for none.
        text: of the base case.

    Raises:
        InputError: with the faults of the base case, and what runs have besides, where they are
            written.
    """
    if not runs:
        return
    no_readings = (NO_READINGS,) if campaign.command == "simulate" else ()

    def faults_of(run: Run) -> tuple[Fault, ...]:
        try:
            parse_case(text, run.case, overrides=(*run.overrides, *no_readings), with_texts=False)
        except InputError as error:
            return error.faults
        return ()

    of_base = faults_of(campaign.base)
    faults = [placed(fault, campaign.base) for fault in of_base]
    wrong_paths: set[str] = set()
    for run in _telling(runs):
        for fault in faults_of(run):
            if fault in of_base or (fault.code in _OF_PATHS and fault.path in wrong_paths):
                continue  # said of the base case, or of another value
            wrong_paths.add(fault.path)
            at_setting = placed(fault, run)
            if at_setting.location.file == run.case:
                message = f"in the run {run.name}: {fault.message}"
                at_setting = replace(at_setting, message=message)
            faults.append(at_setting)
    if faults:
        raise InputError(in_order(faults))


def _telling(runs: Sequence[Run]) -> list[Run]:
    """The first run with each value of each path; of numbers in one unit those with the ends."""
    chosen: dict[str, Run] = {}
    all_settings = [dict(run.settings) for run in runs]
    for path in varied_paths(runs):
        first: dict[str, Run] = {}
        for run, settings in zip(runs, all_settings, strict=True):
            if path in settings:
                first.setdefault(settings[path], run)
        values = list(first)
        with suppress(ValueError):  # not all are numbers
            ordered = sorted(first, key=lambda value: float(value.partition(" ")[0]))
            if len({value.partition(" ")[2] for value in values}) == 1:
                values = [ordered[0], ordered[-1]]
        chosen |= {first[value].name: first[value] for value in values}
        if len(chosen) >= _MOST:
            break
    return list(chosen.values())[:_MOST]
