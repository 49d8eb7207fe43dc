"""``geoident doctor``."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING

import click

from geoident.cli.options import Options, always, takes

if TYPE_CHECKING:
    from geoident.workflow.doctor import Diagnosis

EPILOG = """\b
Examples:
  geoident doctor
  geoident doctor --json | jq .versions
"""


@click.command(epilog=EPILOG)
@takes("as_json", after=always("geoident init my-case"))
def command(options: Options) -> int:
    """Show versions, solvers and threads, and how to get faster ones."""
    from geoident.report.text.json import dumps
    from geoident.workflow.doctor import diagnose

    diagnosis = diagnose()
    click.echo(dumps(asdict(diagnosis)) if options.as_json else _text(diagnosis))
    return 0


def _text(diagnosis: Diagnosis) -> str:
    from geoident.report.text.layout import TextTable, bullets, section, sections

    versions = [[name, version] for name, version in diagnosis.versions.items()]
    solvers = [
        [
            solver.name,
            solver.version or "not installed",
            str(solver.threads) if solver.available else "-",
            _use(solver.name, diagnosis),
        ]
        for solver in diagnosis.solvers
    ]
    extras = [
        [extra.use, f"{extra.package} {extra.version}" if extra.version else extra.remedy]
        for extra in diagnosis.extras
    ]
    memory = ""
    if diagnosis.memory is not None:
        memory = f", {diagnosis.memory / 1e9:.1f} GB of memory"
    limits = ", ".join(f"{name}={value}" for name, value in diagnosis.threads.items())
    return sections(
        TextTable(("program", "version"), versions).text,
        TextTable(("solver", "from", "threads", ""), solvers, right="llrl").text,
        TextTable(("extra", "from"), extras).text,
        f"{diagnosis.platform}, {diagnosis.cores} cores{memory}"
        + (f", {limits}" if limits else ""),
        section("To be faster", bullets(diagnosis.remedies)),
    )


def _use(solver: str, diagnosis: Diagnosis) -> str:
    """What a solver is used for."""
    if solver == diagnosis.picked_beyond:
        return "used where a factor takes too much time or memory"
    return "used" if solver == diagnosis.picked else ""
