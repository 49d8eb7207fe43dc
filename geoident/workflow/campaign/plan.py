"""From a campaign file to its runs: names, what each is made of, what is known of them already."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

from geoident import __version__
from geoident.errors import Fault, InputError, OutputError, Term
from geoident.forward.external.program import ProgramModel
from geoident.io.campaign.file import read_campaign
from geoident.io.case.file import parse_case
from geoident.io.mesh.file import mesh_files
from geoident.io.result.campaign import (
    CampaignHead,
    read_head,
    read_journal,
    tables_are_newer,
)
from geoident.io.result.file import FORMAT, read_identity
from geoident.io.schema.run_file import is_file
from geoident.io.text.campaign_folder import JOURNAL
from geoident.io.text.faults import shortened
from geoident.io.text.named_files import named_files
from geoident.io.text.text_file import decode, read_bytes, seen_from
from geoident.io.text.yaml_reader import MAX_BYTES, Node, parse_yaml
from geoident.model.campaign import SEED, Campaign
from geoident.model.cluster import Cluster
from geoident.model.external import ExternalSource
from geoident.model.results.many.campaign import RunRecord
from geoident.model.run import Run, Setting, varied_paths
from geoident.workflow.campaign.sampling import sampled
from geoident.workflow.programs.digest import known_sha256, model_files
from geoident.workflow.programs.workplace import cluster_given, trusted
from geoident.workflow.running.jobs import NO_READINGS, build_model, load_inputs
from geoident.workflow.running.run_table import in_order, placed


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
        InputError: with all faults of the campaign and its table, or else of the base case and of
            runs as far as they are looked at before.
        OutputError: the folder is of another campaign, or is none.
    """
    campaign = read_campaign(path)
    rows = campaign.runs
    if campaign.sampling is not None:
        rows = sampled(campaign.sampling, campaign.case)
    folder, paths = folder_of(path, output), varied_paths(rows)
    text = decode(read_bytes(campaign.case, limit=MAX_BYTES, what="case"), campaign.case)
    data = parse_yaml(text, campaign.case).data
    fit = read_identity(campaign.result) if campaign.result else None
    fingerprint = "" if fit is None else fit.fingerprint
    runs = _planned(campaign, rows, paths, _depends_on(campaign, rows, data, fingerprint))
    _require_own(folder, path, force=force)
    head, records = (None, ()) if fresh else read_journal(folder)
    known = _known(runs, records, folder)
    of_fit = [campaign.result] if campaign.result else []
    inputs = (campaign.path, campaign.case, *of_fit, *_named(campaign, rows, data))
    inputs = tuple(dict.fromkeys(inputs))
    plan = CampaignPlan(campaign, folder, paths, runs, known, inputs, fit=fingerprint)
    if head == plan.head and len(records) == len(known) == len(runs):
        plan = replace(plan, settled=tables_are_newer(folder))
    if left := [row for row in rows if row.name not in known]:
        _check(campaign, left, text)
    return plan


def cluster_of(plan: CampaignPlan, stated: str | None) -> Cluster | None:
    """The cluster for the runs of a campaign; None for processes of this machine.

    Args:
        plan: of the campaign.
        stated: by who calls, in place of that of the campaign: an address, ``local``, or the path
            of a cluster file; None for none.

    Raises:
        InputError: there is no such cluster, or nobody has said that what a file names may be run.
        MissingExtra: dask is not installed.
    """
    if stated is not None:
        return cluster_given(stated)
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
    base = plan.campaign.base
    inputs = load_inputs(base.case, overrides=(*base.overrides, NO_READINGS))
    if inputs.case.elsewhere is None:
        return ()
    model = build_model(inputs)
    return (model.runs.require_trust(),) if isinstance(model, ProgramModel) else ()


def _known(
    runs: Sequence[PlannedRun], records: Iterable[RunRecord], folder: Path
) -> dict[str, RunRecord]:
    """Records of runs that would end the same way again, and whose files are there."""
    by_name = {record.name: record for record in records}
    return {
        run.name: replace(record, settings=run.varied)
        for run in runs
        if (record := by_name.get(run.name)) is not None
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
            raise OutputError(
                f"{folder}: is not a folder of a campaign, and not empty\n    {remedy}"
            )
        return
    head = read_head(folder)
    if head is not None and head.campaign_file != seen_from(folder, path):
        other = head.campaign_file
        raise OutputError(f"{folder}: has the runs of another campaign ({other})\n    {remedy}")


def _named(campaign: Campaign, rows: Sequence[Run], data: Node) -> tuple[str, ...]:
    """Paths of all files that a base case or a run names, or that decide what its model gives."""
    folder = Path(campaign.case).parent
    named = list(named_files(data, folder))
    with suppress(InputError):  # its faults are told with those of the runs
        model = model_of(campaign, data)
        named += [] if model is None else model_files(model)
    values = {value for run in (campaign.base, *rows) for _, value in run.settings}
    named += [str(folder / value) for value in sorted(values) if is_file(folder / value)]
    return tuple(part for name in named for part in mesh_files(name))


def _depends_on(
    campaign: Campaign, rows: Sequence[Run], data: Node, fingerprint: str
) -> list[Node]:
    """What the runs depend on beside their settings: the base case, and checksums of files.

    No reading enters a simulation, so neither those of the case nor their files count for it.

    Args:
        campaign: with the base case.
        rows: what its runs set.
        data: the base case.
        fingerprint: of the fit that is predicted from; empty where it has none.
    """
    if campaign.command == "simulate":
        if isinstance(data, dict):
            data = {key: value for key, value in data.items() if key != "readings"}
        return [data, *map(known_sha256, _named(campaign, rows, data))]
    of_fit = [fingerprint or known_sha256(campaign.result)] if campaign.result else []
    named = _named(campaign, rows, data)
    return [known_sha256(campaign.case), *of_fit, *map(known_sha256, named)]


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
    overrides = (*campaign.base.overrides, NO_READINGS)
    return load_inputs(campaign.case, overrides=overrides).case.elsewhere


def _planned(
    campaign: Campaign, rows: Sequence[Run], paths: Sequence[str], depends_on: list[Node]
) -> tuple[PlannedRun, ...]:
    """The runs with what each depends on, as a hash.

    Raises:
        InputError: a seed is none.
    """
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
    for row in rows:
        seed, settings = campaign.seed, dict(row.settings)
        if SEED in settings and not (settings[SEED].isdecimal() and len(settings[SEED]) < 19):
            message = f"'{settings[SEED]}' is not a seed; a whole number from 0 on is expected"
            hint = "Write seeds out, such as seed: [1, 2, 3] in a product; they cannot be sampled."
            place = dict(zip(settings, row.places, strict=True))[SEED]
            faults.append(Fault("bad-count", message, hint, place, SEED))
        elif SEED in settings:
            seed = int(settings[SEED])
        key = digest.copy()
        key.update(json.dumps([row.settings, seed], ensure_ascii=False).encode())
        varied = tuple((path, settings.get(path, "")) for path in paths)
        overrides = _of_case(row).on(campaign.base).overrides
        runs.append(PlannedRun(row.name, key.hexdigest(), overrides, varied, seed))
    if faults:
        raise InputError(shortened(faults))
    return tuple(runs)


def _of_case(row: Run) -> Run:
    """A run without its seed, which is no value of the case."""
    pairs = zip(row.settings, row.places, strict=True)
    kept = [(setting, place) for setting, place in pairs if setting[0] != SEED]
    settings, places = tuple(setting for setting, _ in kept), tuple(place for _, place in kept)
    return replace(row, settings=settings, places=places)


# Whether the cases of the runs are right

_CHECKED = 50
"""Runs whose cases are read before anything is computed."""

_OF_PATHS = ("bad-override", "unknown-key")
"""Faults that do not depend on the value."""


def _check(campaign: Campaign, rows: Sequence[Run], text: str) -> None:
    """Read the base case, and the cases of some runs.

    Args:
        campaign: with the base case.
        rows: runs that are to be computed.
        text: of the base case.

    Raises:
        InputError: with the faults of the base case, and what runs have besides, where they are
            written.
    """
    no_readings = (NO_READINGS,) if campaign.command == "simulate" else ()

    def faults_of(run: Run) -> tuple[Fault, ...]:
        try:
            parse_case(text, run.case, overrides=(*run.overrides, *no_readings), with_texts=False)
        except InputError as error:
            return error.faults
        return ()

    of_base = faults_of(campaign.base)
    faults = [placed(fault, campaign.base) for fault in of_base]
    paths: set[str] = set()
    for row in _telling(rows):
        run = _of_case(row).on(campaign.base)
        for fault in faults_of(run):
            if fault in of_base or (fault.code in _OF_PATHS and fault.path in paths):
                continue  # said of the base case, or of another value
            paths.add(fault.path)
            of_run = placed(fault, run)
            if of_run.location.file == run.case:
                of_run = replace(of_run, message=f"in the run {run.name}: {of_run.message}")
            faults.append(of_run)
    if faults:
        raise InputError(in_order(faults))


def _telling(rows: Sequence[Run]) -> list[Run]:
    """Runs with a value that no earlier one has; of numbers in one unit the ends."""
    chosen: dict[str, Run] = {}
    for path in varied_paths(rows):
        with_value: dict[str, Run] = {}
        for row in rows:
            for other, value in row.settings:
                if other == path:
                    with_value.setdefault(value, row)
        values = list(with_value)
        with suppress(ValueError):  # not all are numbers
            numbers = {value: float(value.partition(" ")[0]) for value in values}
            if len({value.partition(" ")[2] for value in values}) == 1:
                values = [
                    min(values, key=numbers.__getitem__),
                    max(values, key=numbers.__getitem__),
                ]
        chosen |= {with_value[value].name: with_value[value] for value in values}
        if len(chosen) >= _CHECKED:
            break
    return list(chosen.values())[:_CHECKED]
