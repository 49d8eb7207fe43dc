"""From a campaign file to its runs: names, what each is made of, what is known of them already."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

from geoident import __version__
from geoident.errors import Fault, InputError, Location, OutputError, Term
from geoident.forward.external.program import ProgramModel
from geoident.io.campaign.file import FaultyCampaign, read_campaign
from geoident.io.case.file import parse_case
from geoident.io.mesh.file import mesh_files
from geoident.io.result.campaign import (
    CampaignHead,
    read_head,
    read_journal,
    tables_are_newer,
)
from geoident.io.result.file import FORMAT, read_identity
from geoident.io.text.campaign_folder import JOURNAL
from geoident.io.text.faults import OVERRIDES, shortened
from geoident.io.text.named_files import named_files
from geoident.io.text.overrides import parse_path
from geoident.io.text.text_file import decode, read_bytes, seen_from
from geoident.io.text.yaml_reader import MAX_BYTES, Node, parse_yaml
from geoident.model.campaign import SEED, Campaign, Setting, Variation, overrides_of, paths_of
from geoident.model.case import format_path
from geoident.model.cluster import Cluster
from geoident.model.external import ExternalSource
from geoident.model.results.many.campaign import RunRecord
from geoident.workflow.campaign.sampling import sampled
from geoident.workflow.programs.digest import model_files
from geoident.workflow.programs.workplace import cluster_given, trusted
from geoident.workflow.running.jobs import NO_READINGS, build_model, load_inputs

_CHECKED = 50
"""Runs whose cases are read before anything is computed."""


@dataclass(frozen=True)
class PlannedRun:
    """A run.

    Args:
        name: of it and of its files.
        key: hash of everything that it depends on.
        overrides: of the base case.
        varied: what varies, in the order of the campaign's paths.
        seed: of random numbers.
    """

    name: str
    key: str
    overrides: tuple[str, ...]
    varied: tuple[Setting, ...]
    seed: int


@dataclass(frozen=True)
class CampaignPlan:
    """A campaign that was read, and what is known of its runs.

    Args:
        campaign: what its file says.
        folder: for its results.
        paths: what varies.
        runs: all of them.
        known: name to record of those that need not be computed.
        inputs: paths of all that is read, which no output may replace.
        settled: journal and tables have these runs and no others, all of them known.
        fit: `Result.fingerprint` of the fit that is predicted from; empty where nothing is.
    """

    campaign: Campaign
    folder: Path
    paths: tuple[str, ...]
    runs: tuple[PlannedRun, ...]
    known: Mapping[str, RunRecord]
    inputs: tuple[str, ...]
    settled: bool = False
    fit: str = ""

    @property
    def remaining(self) -> tuple[PlannedRun, ...]:
        """The runs that are to be computed."""
        return tuple(run for run in self.runs if run.name not in self.known)

    @property
    def head(self) -> CampaignHead:
        """What the journal says of the campaign."""
        return CampaignHead(
            title=self.campaign.title,
            command=self.campaign.command,
            campaign_file=seen_from(self.folder, self.campaign.path),
            case_file=seen_from(self.folder, self.campaign.case),
            paths=self.paths,
            total=len(self.runs),
            fit_file=seen_from(self.folder, self.campaign.result) if self.campaign.result else "",
            fit_fingerprint=self.fit,
        )


def folder_of(path: str, output: str | None) -> Path:
    """The folder for the results of a campaign: CAMPAIGN.batch beside its file, or as given."""
    return Path(path).with_suffix(".batch") if output is None else Path(output)


def plan_campaign(
    path: str, *, output: str | None = None, fresh: bool = False, force: bool = False
) -> CampaignPlan:
    """Read a campaign, and look at what is known of its runs.

    Args:
        path: of its file.
        output: folder for its results; None for CAMPAIGN.batch beside it.
        fresh: nothing counts as known.
        force: the folder may hold something else.

    Raises:
        InputError: with all faults of the campaign, its table, the base case, and of runs as far
            as they are looked at before.
        OutputError: the folder is of another campaign, or is none.
    """
    try:
        campaign = read_campaign(path)
    except FaultyCampaign as error:
        further = () if error.sound is None else _found(error.sound, _variations(error.sound))
        raise InputError(_in_order((*error.faults, *further))) from error
    variations = _variations(campaign)
    folder, paths = folder_of(path, output), paths_of(variations)
    data = _base(campaign)
    inputs, fit = _inputs(campaign, variations, data), _fit(campaign)
    runs = _runs(campaign, variations, paths, _depends_on(campaign, variations, data, fit))
    _require_own(folder, path, force=force)
    known: dict[str, RunRecord] = {}
    head, records = (None, ()) if fresh else read_journal(folder)
    if records:
        known = _known(runs, records, folder)
    plan = CampaignPlan(campaign, folder, paths, runs, known, inputs, fit=fit)
    if head == plan.head and len(records) == len(known) == len(runs):
        plan = replace(plan, settled=tables_are_newer(folder))
    left = {run.name for run in plan.remaining}
    if left:
        _check(campaign, [run for run in variations if run.name in left])
    return plan


def _variations(campaign: Campaign) -> tuple[Variation, ...]:
    return campaign.variations if campaign.sampling is None else sampled(campaign.sampling)


def cluster_of(plan: CampaignPlan, given: str | None) -> Cluster | None:
    """The cluster for the runs of a campaign; None for processes of this machine.

    Args:
        plan: of the campaign.
        given: by who calls, in place of that of the campaign: an address, ``local``, or the path of
            a cluster file; None for none.

    Raises:
        InputError: there is no such cluster, or nobody has said that what a file names may be run.
        MissingExtra: dask is not installed.
    """
    if given is not None:
        return cluster_given(given)
    where = plan.campaign.cluster
    return trusted(where) if where is not None and plan.remaining else where


def require_trust(plan: CampaignPlan) -> tuple[str, ...]:
    """Ask whether the base case may run what it names, before processes that cannot ask begin.

    Returns:
        `Execution.portable` of what may be run; nothing where nothing is.

    Raises:
        InputError: it may not.
    """
    if not plan.remaining:
        return ()
    campaign = plan.campaign
    inputs = load_inputs(campaign.case, overrides=(*overrides_of(campaign.settings), NO_READINGS))
    if inputs.case.elsewhere is None:
        return ()
    model = build_model(inputs)
    return (model.runs.require_trust(),) if isinstance(model, ProgramModel) else ()


def _known(
    runs: Sequence[PlannedRun], records: Iterable[RunRecord], folder: Path
) -> dict[str, RunRecord]:
    """Records of runs that would end the same way again, and whose files are there."""
    found = {record.name: record for record in records}
    return {
        run.name: replace(record, settings=run.varied)
        for run in runs
        if (record := found.get(run.name)) is not None
        and record.key == run.key
        and record.final
        and (not record.file or (folder / record.file).is_file())
    }


def _require_own(folder: Path, path: str, *, force: bool) -> None:
    """Refuse a folder that holds something else."""
    if folder.exists() and not folder.is_dir():
        raise OutputError(
            f"{folder}: is a file, not a folder\n    choose another place with {Term.OUTPUT}"
        )
    if force or not folder.is_dir():
        return
    remedy = f"{Term.FORCE} uses it nonetheless, {Term.OUTPUT} names another one"
    if not (folder / JOURNAL).is_file():
        if any(folder.iterdir()):
            raise OutputError(f"{folder}: is no folder of a campaign, and not empty\n    {remedy}")
        return
    head = read_head(folder)
    if head is not None and head.campaign_file != seen_from(folder, path):
        other = head.campaign_file
        raise OutputError(f"{folder}: has the runs of another campaign ({other})\n    {remedy}")


def _base(campaign: Campaign) -> Node:
    """The base case as mappings, lists and texts."""
    text = decode(read_bytes(campaign.case, limit=MAX_BYTES, what="case"), campaign.case)
    return parse_yaml(text, campaign.case).data


def _fit(campaign: Campaign) -> str:
    """Fingerprint of the fit that is predicted from; empty where there is none."""
    found = read_identity(campaign.result) if campaign.result else None
    return "" if found is None else found.fingerprint


def _inputs(campaign: Campaign, variations: Sequence[Variation], data: Node) -> tuple[str, ...]:
    """Paths of the campaign, of its base case and of all files that this or a run names."""
    of_fit = [campaign.result] if campaign.result else []
    named = _named(campaign, variations, data)
    return tuple(dict.fromkeys((campaign.path, campaign.case, *of_fit, *named)))


def _named(campaign: Campaign, variations: Sequence[Variation], data: Node) -> tuple[str, ...]:
    """Paths of all files that a base case or a run names."""
    folder = Path(campaign.case).parent
    named = [*named_files(data, folder), *_of_model(campaign, data)]
    values = {value for run in variations for _, value in run.settings}
    named += [str(folder / value) for value in sorted(values | _values(campaign.settings))
              if _is_file(folder / value)]  # fmt: skip
    return tuple(part for name in named for part in mesh_files(name))


def _depends_on(
    campaign: Campaign, variations: Sequence[Variation], data: Node, fit: str
) -> list[Node]:
    """What the runs depend on beside their settings: the base case, and checksums of files.

    No reading enters a simulation, so neither those of the case nor their files count for it.

    Args:
        campaign: with the base case.
        variations: what its runs set.
        data: the base case.
        fit: fingerprint of the fit that is predicted from.
    """
    of_fit: list[Node] = [fit or _sum(campaign.result)] if campaign.result else []
    if campaign.command != "simulate":
        return [_sum(campaign.case), *of_fit, *map(_sum, _named(campaign, variations, data))]
    without = data
    if isinstance(data, dict):
        without = {key: value for key, value in data.items() if key != "readings"}
    return [without, *map(_sum, _named(campaign, variations, without))]


def _of_model(campaign: Campaign, data: Node) -> tuple[str, ...]:
    """Files that decide what a model elsewhere gives, also those that the case does not name."""
    with suppress(InputError):  # its faults are told with those of the runs
        found = model_of(campaign, data)
        return () if found is None else model_files(found)
    return ()


def model_of(campaign: Campaign, data: Node) -> ExternalSource | None:
    """The model of the base case where that is elsewhere; None of one with ground of its own.

    Args:
        campaign: with it.
        data: the base case as mappings, lists and texts.

    Raises:
        InputError: the case is wrong.
    """
    if not (isinstance(data, dict) and "model" in data):
        return None
    said = (*overrides_of(campaign.settings), NO_READINGS)
    return load_inputs(campaign.case, overrides=said).case.elsewhere


def _values(settings: Sequence[Setting]) -> set[str]:
    return {value for _, value in settings}


def _is_file(path: Path) -> bool:
    try:
        return path.is_file()
    except (OSError, ValueError):
        return False


def _runs(
    campaign: Campaign,
    variations: Sequence[Variation],
    paths: Sequence[str],
    depends_on: list[Node],
) -> tuple[PlannedRun, ...]:
    common = {
        "command": campaign.command,
        "version": __version__,
        "format": FORMAT,
        "inputs": depends_on,
        "settings": campaign.settings,
        "noise": campaign.noise,
        "draw": campaign.draw,
        "stages": campaign.stages,
    }
    digest = hashlib.sha256(json.dumps(common, sort_keys=True).encode())
    runs, faults = [], []
    for run in variations:
        seed, fault = _seed(campaign, run)
        faults += [fault] if fault else []
        own = digest.copy()
        own.update(json.dumps([run.settings, seed], ensure_ascii=False).encode())
        given = dict(run.settings)
        varied = tuple((path, given.get(path, "")) for path in paths)
        said = overrides_of((*campaign.settings, *run.settings))
        runs.append(PlannedRun(run.name, own.hexdigest(), said, varied, seed))
    if faults:
        raise InputError(shortened(faults))
    return tuple(runs)


_SEED_HINT = "Write seeds out, such as seed: [1, 2, 3] in a product; they cannot be sampled."


def _seed(campaign: Campaign, run: Variation) -> tuple[int, Fault | None]:
    """The seed of a run: its own, else that of the campaign."""
    for (path, value), place in zip(run.settings, run.places, strict=True):
        if path == SEED:
            if value.isdecimal() and len(value) < 19:
                return int(value), None
            message = f"'{value}' is no seed; a whole number from 0 on is expected"
            return 0, Fault("bad-count", message, _SEED_HINT, place, SEED)
    return campaign.seed, None


def _sum(path: str) -> str:
    with suppress(OSError), Path(path).open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
    return ""


# Whether the cases of the runs are right


def _check(campaign: Campaign, variations: Sequence[Variation]) -> None:
    """Read the base case, and the cases of some runs: all faults, where they are written.

    Raises:
        InputError: there are faults.
    """
    if found := _found(campaign, variations):
        raise InputError(_in_order(found))


def _in_order(faults: Iterable[Fault]) -> list[Fault]:
    """Faults in the order of their files, each once."""
    once = {(fault.code, fault.message, fault.location): fault for fault in faults}
    return shortened(
        sorted(once.values(), key=lambda f: (f.location.file, f.location.line, f.location.column))
    )


def _found(campaign: Campaign, variations: Sequence[Variation]) -> list[Fault]:
    """What is wrong in the base case, and what in the cases of some runs is besides."""
    text = decode(read_bytes(campaign.case, limit=MAX_BYTES, what="case"), campaign.case)
    common = Variation("", campaign.settings, campaign.places)
    base = list(_faults(campaign, text, common, Variation("", (), ())))
    known = {(fault.code, fault.message, fault.location) for fault in base}
    faults = [_placed(fault, common, campaign) for fault in base]
    paths = set[str]()
    for run in _telling(variations):
        for fault in _faults(campaign, text, common, run):
            if (fault.code, fault.message, fault.location) in known:
                continue
            if fault.code in _OF_PATHS and fault.path in paths:
                continue  # said of another value of it
            paths.add(fault.path)
            faults.append(_placed(fault, _with(common, run), campaign))
    return faults


_OF_PATHS = ("bad-override", "unknown-key")
"""Faults that do not depend on the value."""

_ROUNDS = 2


def _with(common: Variation, run: Variation) -> Variation:
    """The settings of a run with those of all runs before them."""
    places = (*common.places, *run.places)
    return Variation(run.name, (*common.settings, *run.settings), places)


def _faults(campaign: Campaign, text: str, common: Variation, run: Variation) -> Iterator[Fault]:
    """What is wrong in the case of a run; what is set that it does not have hides nothing else."""
    settings = _with(common, run).settings
    for _ in range(_ROUNDS):
        said = list(overrides_of(settings))
        said += [NO_READINGS] if campaign.command == "simulate" else []
        try:
            parse_case(text, campaign.case, overrides=said, with_texts=False)
        except InputError as error:
            yield from error.faults
            wrong = {fault.path for fault in error.faults if fault.code == "bad-override"}
            left = tuple(s for s in settings if format_path(parse_path(s[0])) not in wrong)
            if len(left) == len(settings):
                return
            settings = left
        else:
            return


def _placed(fault: Fault, run: Variation, campaign: Campaign) -> Fault:
    """A fault where it is written: in the campaign or its table, if it comes from there."""
    if fault.location.file != OVERRIDES:
        which = f"in the run {run.name}: " if run.name else ""
        return replace(fault, message=f"{which}{fault.message}")
    places = dict(zip([path for path, _ in run.settings], run.places, strict=True))
    for path, place in reversed(list(places.items())):
        own = format_path(parse_path(path))
        if fault.path.startswith(own) or own.startswith(fault.path or "?"):
            return replace(fault, location=place)
    return replace(fault, location=Location(campaign.path))


def _telling(variations: Sequence[Variation]) -> list[Variation]:
    """Runs with a value that no earlier one has; of numbers in one unit the ends."""
    chosen: dict[str, Variation] = {}
    for path in paths_of(variations):
        values = [(value, run) for run in variations for p, value in run.settings if p == path]
        ends = _ends(values)
        first: dict[str, Variation] = {}
        for value, run in values:
            first.setdefault(value, run)
        for run in ends or first.values():
            chosen.setdefault(run.name, run)
            if len(chosen) >= _CHECKED:
                return list(chosen.values())
    return list(chosen.values())


def _ends(values: Sequence[tuple[str, Variation]]) -> list[Variation]:
    """Runs with the least and the largest of numbers in one unit; none where they are no such."""
    numbers: list[tuple[float, Variation]] = []
    units: set[str] = set()
    for value, run in values:
        number, _, unit = value.partition(" ")
        try:
            numbers.append((float(number), run))
        except ValueError:
            return []
        units.add(unit)
    if len(units) != 1:
        return []
    ordered = sorted(numbers, key=lambda pair: pair[0])
    return [ordered[0][1], ordered[-1][1]]
