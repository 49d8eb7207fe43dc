"""Reading a campaign file: what it says, or all that is wrong with it and its table."""

from __future__ import annotations

import copy
import itertools
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from geoident.errors import Fault, InputError, Location
from geoident.io.campaign.sections import CampaignSection, SampleSection, VariationsSection
from geoident.io.campaign.table import NAME_COLUMN, NAME_HINT, read_table, run_name_problem
from geoident.io.cluster.file import cluster_of
from geoident.io.schema.faults import add_schema_faults, paths_of
from geoident.io.schema.values import kind_of
from geoident.io.text.faults import Faults, Places
from geoident.io.text.kinds import refuse_other_kind
from geoident.io.text.overrides import is_path, parse_path, written_value
from geoident.io.text.text_file import decode, read_bytes
from geoident.io.text.wording import Refusal, shorten
from geoident.io.text.yaml_reader import MAX_BYTES, parse_yaml
from geoident.model.campaign import Campaign, SampledRange, Sampling, Variation
from geoident.model.case import KeyPath

MOST_RUNS = 1_000_000


class FaultyCampaign(InputError):
    """A campaign with faults of its own text or table.

    Args:
        faults: they.
        sound: the campaign without what is wrong, to be held against its case; None where that is
            none.
    """

    def __init__(self, faults: Iterable[Fault], sound: Campaign | None) -> None:
        self.sound = sound
        super().__init__(faults)


def read_campaign(path: str) -> Campaign:
    """Read a campaign file and its table.

    Args:
        path: the file.

    Raises:
        FaultyCampaign: with all faults found.
    """
    text = decode(read_bytes(path, limit=MAX_BYTES, what="campaign"), path)
    document = parse_yaml(text, path)
    refuse_other_kind(document, "campaign")
    faults = Faults(Places(document, document.data))
    folder = Path(path).parent
    table = _files_and_paths(folder, faults)
    section = _validated(faults)
    if section is None:
        raise FaultyCampaign(faults.shown(), None)
    campaign = _campaign(section, path, table, faults)
    if faults.found:
        raise FaultyCampaign(faults.shown(), campaign if _is_file(Path(campaign.case)) else None)
    return campaign


def _campaign(
    section: CampaignSection, path: str, table: tuple[Variation, ...], faults: Faults
) -> Campaign:
    """What a campaign says; what is wrong beyond its sections is noted."""
    folder, sample, where = Path(path).parent, section.variations.sample, section.cluster
    variations = _named((*table, *_variations(section.variations, faults)), faults)
    cluster = None if where is None else cluster_of(where, ("cluster",), folder, faults)
    fixed = [key for key in section.set if is_path(key)]
    return Campaign(
        path=path,
        title=section.title,
        command=section.command,
        case=str(folder / section.case),
        result="" if section.result is None else str(folder / section.result),
        settings=tuple((key, written_value(section.set[key])) for key in fixed),
        places=tuple(faults.places.locate(("set", key)) for key in fixed),
        variations=variations,
        sampling=None if sample is None else _sampling(sample, faults),
        seed=section.seed,
        solver=section.solver,
        max_time=section.max_time,
        time_limit=section.time_limit,
        retries=section.retries,
        noise=section.noise,
        draw=section.draw,
        stages=tuple(section.stages),
        cluster=cluster,
    )


def _files_and_paths(folder: Path, faults: Faults) -> tuple[Variation, ...]:
    """Look at what the campaign names, whatever else is wrong with it; the runs of its table.

    Args:
        folder: of the campaign.
        faults: takes files that are not there, paths that are none, and what is wrong in the table.
    """
    data = faults.places.data
    if not isinstance(data, dict):
        return ()
    for key in ("case", "result"):
        if isinstance(name := data.get(key), str):
            _require_there(folder / name, (key,), faults)
    _check_paths(data.get("set"), ("set",), faults)
    varied = data.get("variations")
    if not isinstance(varied, dict):
        return ()
    at = ("variations",)
    _check_paths(varied.get("product"), (*at, "product"), faults)
    sample, rows, table = varied.get("sample"), varied.get("rows"), varied.get("table")
    if isinstance(sample, dict):
        _check_paths(sample.get("values"), (*at, "sample", "values"), faults)
    for n, row in enumerate(rows if isinstance(rows, list) else ()):
        _check_paths(row, (*at, "rows", n), faults)
    if not isinstance(table, str) or not _require_there(folder / table, (*at, "table"), faults):
        return ()
    try:
        return read_table(str(folder / table))
    except InputError as error:
        faults.extend(error.faults)
        return ()


def _require_there(path: Path, key: KeyPath, faults: Faults) -> bool:
    there = _is_file(path)
    if not there:
        hint = "Paths are meant from the folder of the campaign file."
        faults.add(key, "missing-file", f"there is no file '{shorten(path)}'", hint)
    return there


def _is_file(path: Path) -> bool:
    try:
        return path.is_file()
    except (OSError, ValueError):
        return False


def _validated(faults: Faults) -> CampaignSection | None:
    """The sections, without those that are wrong, which is noted; None where too little is left."""
    data = faults.places.data
    if not isinstance(data, dict):
        hint = "Begin with 'format: geoident-campaign/1'."
        faults.add((), "wrong-kind", f"found {kind_of(data)}; a mapping is expected", hint)
        return None
    known: dict[int, tuple[str, ...]] = {}
    try:
        return CampaignSection.model_validate(data, context=known)
    except ValidationError as error:
        errors = error.errors(include_url=False)
        add_schema_faults(faults, errors, data, known)
    try:
        left = _without(data, paths_of(errors, data))
        return CampaignSection.model_validate(left, context={})
    except ValidationError:
        return None


_OF_COMMANDS = ("result", "stages", "noise", "draw", "max_time")


def _without(data: Mapping[str, Any], wrong: Iterable[KeyPath]) -> dict[str, Any]:
    """A campaign without its wrong entries; of a wrong command it simulates, which asks least."""
    left = copy.deepcopy(dict(data))
    for path in sorted(set(wrong), key=len, reverse=True):
        end = min(len(path), 3 if path[:1] == ("variations",) else 2)
        holder: Any = left
        for key in path[: end - 1]:
            holder = holder.get(key, {}) if isinstance(holder, dict) else {}
        if isinstance(holder, dict):
            holder.pop(path[end - 1] if path else "", None)
    left |= {"format": "geoident-campaign/1"}
    if "command" not in left and "command" in data:
        left["command"] = "simulate"
        left = {key: value for key, value in left.items() if key not in _OF_COMMANDS}
    return left


def _check_paths(values: object, at: KeyPath, faults: Faults) -> None:
    """Note keys of a mapping that are no paths of values; what is no mapping is noted elsewhere."""
    for name in values if isinstance(values, dict) else ():
        try:
            parse_path(str(name))
        except Refusal as error:
            message = f"'{shorten(name)}' is not the path of a value of a case"
            faults.add((*at, name), error.code, message, error.hint, key=True)


def _variations(given: VariationsSection, faults: Faults) -> tuple[Variation, ...]:
    """The runs that are written out in the campaign itself."""
    if given.rows is not None:
        at = ("variations", "rows")
        if not given.rows:
            faults.add(at, "empty", "there is no run", "Write one mapping a run.")
        return tuple(_row(row, (*at, n), faults) for n, row in enumerate(given.rows))
    if given.product is not None:
        return _product(given.product, ("variations", "product"), faults)
    return ()


def _row(row: Mapping[str, Any], at: KeyPath, faults: Faults) -> Variation:
    name = row.get(NAME_COLUMN, "")
    values = {k: value for k, value in row.items() if k != NAME_COLUMN and is_path(k)}
    places = [faults.places.locate((*at, key)) for key in values]
    settings = tuple((key, written_value(value)) for key, value in values.items())
    return Variation(str(name or ""), settings, (*places, faults.places.locate(at)))


def _product(
    lists: Mapping[str, Sequence[Any]], at: KeyPath, faults: Faults
) -> tuple[Variation, ...]:
    count = 1
    for values in lists.values():
        count *= len(values)
    if count > MOST_RUNS:
        message = f"the product has {count} runs; {MOST_RUNS} are the most"
        faults.add(at, "too-many", message, "Sample the space instead: variations.sample.")
        return ()
    locate = faults.places.locate
    choices = [
        [((key, written_value(value)), locate((*at, key, n))) for n, value in enumerate(values)]
        for key, values in lists.items()
        if is_path(key)
    ]
    return tuple(
        Variation("", tuple(s for s, _ in chosen), (*(p for _, p in chosen), locate(at)))
        for chosen in itertools.product(*choices)
    )


def _sampling(section: SampleSection, faults: Faults) -> Sampling:
    at = ("variations", "sample", "values")
    spans = []
    for path, span in section.values.items():
        if not is_path(path):
            continue
        kind, (first, unit), (second, _) = span.ends
        place = faults.places.locate((*at, path))
        spans.append(SampledRange(path, kind, first, second, unit, place))
    return Sampling(section.method, section.count, section.seed, tuple(spans))


def _named(runs: Sequence[Variation], faults: Faults) -> tuple[Variation, ...]:
    """The runs with a name each: their own, or their number; two of one name are a fault."""
    width = max(4, len(str(len(runs))))
    named: list[Variation] = []
    seen: dict[str, Location] = {}
    found: list[Fault] = []
    for number, run in enumerate(runs, 1):
        name, place = run.name or f"{number:0{width}d}", run.places[-1]
        problem = run_name_problem(name)
        if problem:
            found.append(Fault("bad-name", problem, NAME_HINT, place))
        elif name.lower() in seen:
            message = f"the run '{name}' would share its files with that of line "
            message += str(seen[name.lower()].line)
            found.append(Fault("same-run", message, "Give each run a name of its own.", place))
        seen.setdefault(name.lower(), place)
        named.append(replace(run, name=name, places=run.places[:-1]))
    faults.extend(found)
    return tuple(named)
