"""Reading a campaign file: what it says, or all that is wrong with it and its table."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from geoident.errors import Fault, InputError, Location
from geoident.io.campaign.sections import CampaignSection, SampleSection, VariationsSection
from geoident.io.campaign.table import NAME_COLUMN, NAME_HINT, read_table, run_name_problem
from geoident.io.cluster.file import cluster_of
from geoident.io.schema.faults import node_at
from geoident.io.schema.run_file import open_run_file, require_file, settings_of, validated
from geoident.io.text.faults import Faults
from geoident.io.text.overrides import written_value
from geoident.model.campaign import Campaign, SampledRange, Sampling
from geoident.model.run import Run

MOST_RUNS = 1_000_000


def read_campaign(path: str) -> Campaign:
    """Read a campaign file and its table; its case is not read.

    Args:
        path: the file.

    Raises:
        InputError: with all faults of its keys, its table and the files that it names.
    """
    faults = open_run_file(path, "campaign")
    folder = Path(path).parent
    table: list[Run] = []
    for key in (("case",), ("result",), ("variations", "table")):
        name = node_at(faults.places.data, key)
        if isinstance(name, str) and require_file(folder / name, key, faults, "campaign"):
            try:
                table = read_table(str(folder / name)) if key[-1] == "table" else []
            except InputError as error:
                faults.extend(error.faults)
    section = validated(CampaignSection, faults, "campaign")
    case = str(folder / section.case)
    runs = _named([*table, *_written_runs(section.variations, faults)], faults)
    where, sample = section.cluster, section.variations.sample
    settings, places = settings_of(section.set, ("set",), faults)
    campaign = section.to_model(
        Campaign,
        path=path,
        case=case,
        result="" if section.result is None else str(folder / section.result),
        settings=settings,
        places=places,
        runs=tuple(replace(run, case=case) for run in runs),
        sampling=None if sample is None else _sampling(sample, faults),
        cluster=None if where is None else cluster_of(where, ("cluster",), folder, faults),
    )
    faults.raise_any()
    return campaign


def _written_runs(given: VariationsSection, faults: Faults) -> list[Run]:
    """The runs that are written out in the campaign itself, one by one or as a product."""
    locate = faults.places.locate
    if given.rows is not None:
        at = ("variations", "rows")
        if not given.rows:
            faults.add(at, "empty", "there is no run", "Write one mapping a run.")
        return [_row(row, locate((*at, n)), (*at, n), faults) for n, row in enumerate(given.rows)]
    if given.product is None:
        return []
    at, lists = ("variations", "product"), given.product
    count = math.prod(map(len, lists.values()))
    if count > MOST_RUNS:
        message = f"the product has {count} runs; {MOST_RUNS} are the most"
        faults.add(at, "too-many", message, "Sample the space instead: variations.sample.")
        return []
    choices = [
        [((path, written_value(value)), locate((*at, path, n))) for n, value in enumerate(values)]
        for path, values in lists.items()
    ]
    place = locate(at)
    return [
        Run("", "", tuple(setting for setting, _ in row), tuple(where for _, where in row), place)
        for row in itertools.product(*choices)
    ]


def _row(row: Mapping[str, Any], place: Location, at: tuple[str | int, ...], faults: Faults) -> Run:
    values = {path: value for path, value in row.items() if path != NAME_COLUMN}
    return Run(str(row.get(NAME_COLUMN) or ""), "", *settings_of(values, at, faults), place)


def _sampling(section: SampleSection, faults: Faults) -> Sampling:
    spans = []
    for path, span in section.values.items():
        kind, (first, unit), (second, _) = span.ends
        place = faults.places.locate(("variations", "sample", "values", path))
        spans.append(SampledRange(path, kind, first, second, unit, place))
    return Sampling(section.method, section.count, section.seed, tuple(spans))


def _named(runs: Sequence[Run], faults: Faults) -> list[Run]:
    """The runs with a name each: their own, or their number; two of one name are a fault."""
    width = max(4, len(str(len(runs))))
    named: list[Run] = []
    seen: dict[str, Location] = {}
    for number, run in enumerate(runs, 1):
        name = run.name or f"{number:0{width}d}"
        if problem := run_name_problem(name):
            faults.extend([Fault("bad-name", problem, NAME_HINT, run.place)])
        elif name.lower() in seen:
            message = f"the run '{name}' would share its files with that of line "
            message += str(seen[name.lower()].line)
            hint = "Give each run a name of its own."
            faults.extend([Fault("same-run", message, hint, run.place)])
        seen.setdefault(name.lower(), run.place)
        named.append(replace(run, name=name))
    return named
