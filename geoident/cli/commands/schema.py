"""``geoident schema``."""

# ruff: noqa: PLC0415 - the parts are imported when needed: --help must not wait for them

from __future__ import annotations

import click

from geoident.cli.options import Options, takes

EPILOG = """\b
Examples:
  geoident schema > case.schema.json
"""


@click.command(epilog=EPILOG)
@takes()
def command(options: Options) -> int:
    """Print the JSON schema of case files, for editors."""
    import json

    from geoident.workflow.schema import schema

    click.echo(json.dumps(schema(), indent=2))
    return 0
