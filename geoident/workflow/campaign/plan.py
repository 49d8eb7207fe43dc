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
from geoident.io.mesh.file import mesh_files
from geoident.io.result.campaign import CampaignHead, read_head, read_journal, tables_are_newer
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
from geoident.workflow.campaign.check import require_right_cases
from geoident.workflow.campaign.sampling import sampled
from geoident.workflow.programs.digest import known_sha256, model_files
from geoident.workflow.programs.workplace import cluster_given, trusted
from geoident.workflow.running.jobs import NO_READINGS, build_model, load_inputs


@dataclass(frozen=True)
class PlannedRun(Run):
    """A run of a campaign, with the settings of all its runs before its own.

    Args:
        key: hash of everything that it depends on.
        varied: what varies, in the order of the campaign's paths; a value that the run leaves as it
            is, empty.
        seed: of random numbers.
    """

    key: str = ""
    varied: tuple[Setting, ...] = ()
    seed: int = 0


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
        model: of the base case, where that is elsewhere; None for ground of its own.
        settled: journal and tables have these runs and no others, all of them known.
        fit: `Result.fingerprint` of the fit that is predicted from; empty where nothing is.
    """

    campaign: Campaign
    folder: Path
    paths: tuple[str, ...]
    runs: tuple[PlannedRun, ...]
    known: Mapping[str, RunRecord]
    inputs: tuple[str, ...]
    model: ExternalSource | None = None
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
    text = decode(read_bytes(campaign.case, limit=MAX_BYTES, what="case"), campaign.case)
    data = parse_yaml(text, campaign.case).data
    model = None
    if isinstance(data, dict) and "model" in data:
        with suppress(InputError):  # its faults are told with those of the runs
            overrides = (*campaign.base.overrides, NO_READINGS)
            model = load_inputs(campaign.case, overrides=overrides).case.elsewhere
    fit = read_identity(campaign.result) if campaign.result else None
    fingerprint = "" if fit is None else fit.fingerprint

    results = [campaign.result] if campaign.result else []
    named = _named_files(campaign, rows, data, model)
    if campaign.command != "simulate":
        of_fit = [fingerprint or known_sha256(results[0])] if results else []
        depends_on: list[Node] = [known_sha256(campaign.case), *of_fit, *map(known_sha256, named)]
    else:  # no reading enters: neither those of the case count nor their files
        if isinstance(data, dict):
            data = {key: value for key, value in data.items() if key != "readings"}
        depends_on = [data, *map(known_sha256, _named_files(campaign, rows, data, model))]
    paths = varied_paths(rows)
    runs = _planned(campaign, rows, paths, depends_on)

    folder = folder_of(path, output)
    _require_own(folder, path, force=force)
    head, records = (None, ()) if fresh else read_journal(folder)
    known = _known(runs, records, folder)
    inputs = tuple(dict.fromkeys((campaign.path, campaign.case, *results, *named)))
    plan = CampaignPlan(campaign, folder, paths, runs, known, inputs, model, fit=fingerprint)
    if head == plan.head and len(records) == len(known) == len(runs):
        plan = replace(plan, settled=tables_are_newer(folder))
    require_right_cases(campaign, plan.remaining, text)
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
    if plan.model is None or not plan.remaining:
        return ()
    base = plan.campaign.base
    model = build_model(load_inputs(base.case, overrides=(*base.overrides, NO_READINGS)))
    return (model.runs.require_trust(),) if isinstance(model, ProgramModel) else ()


def _named_files(
    campaign: Campaign, rows: Sequence[Run], data: Node, model: ExternalSource | None
) -> list[str]:
    """Paths of all files that the base case or a run names, or that decide what its model gives.

    Args:
        campaign: with the base case.
        rows: what its runs set.
        data: the base case as mappings, lists and texts.
        model: of the base case.
    """
    folder = Path(campaign.case).parent
    values = {value for run in (campaign.base, *rows) for _, value in run.settings}
    named = [*named_files(data, folder), *(() if model is None else model_files(model))]
    named += [str(folder / value) for value in sorted(values) if is_file(folder / value)]
    return [part for name in named for part in mesh_files(name)]


def _planned(
    campaign: Campaign, rows: Sequence[Run], paths: Sequence[str], depends_on: list[Node]
) -> tuple[PlannedRun, ...]:
    """The runs with what each depends on, as a hash.

    Args:
        campaign: with what is set in all runs.
        rows: what each run sets beside, its seed among it.
        paths: all that is set in some row.
        depends_on: the base case and checksums of files, on which all depend.

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
        places = dict(zip(row.settings, row.places, strict=True))
        settings = dict(row.settings)
        stated, seed = settings.get(SEED), campaign.seed
        if stated is not None:
            if not (stated.isdecimal() and len(stated) < 19):
                message = f"'{stated}' is not a seed; a whole number from 0 on is expected"
                hint = "Write seeds out, such as seed: [1, 2, 3] in a product; "
                hint += "they cannot be sampled."
                faults.append(Fault("bad-count", message, hint, places[SEED, stated], SEED))
                continue
            del places[SEED, stated]
            seed = int(stated)
        key = digest.copy()
        key.update(json.dumps([row.settings, seed], ensure_ascii=False).encode())
        run = replace(row, settings=tuple(places), places=tuple(places.values()))
        run = run.on(campaign.base)
        varied = tuple((path, settings.get(path, "")) for path in paths)
        runs.append(PlannedRun(**vars(run), key=key.hexdigest(), varied=varied, seed=seed))
    if faults:
        raise InputError(shortened(faults))
    return tuple(runs)


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
    """Refuse a folder that holds something else.

    Raises:
        OutputError: it does, or is a file.
    """
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
