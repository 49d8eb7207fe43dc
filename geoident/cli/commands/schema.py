"""``geoident schema``."""

# ruff: noqa: PLC0415 - the parts are imported when needed: --help must not wait for them

from __future__ import annotations

import click

from geoident.cli.next_steps import always
from geoident.cli.options import Options, takes

EPILOG = """\b
Examples:
  geoident schema > case.schema.json
  geoident schema --markdown | less

\b
An editor with a YAML language server completes and checks a case whose first line is
  # yaml-language-server: $schema=case.schema.json
"""


@click.command(epilog=EPILOG)
@click.option("--markdown", is_flag=True, help="The page of all keys, for people.")
@takes(after=always("write in the first line of a case: # yaml-language-server: $schema=FILE"))
def command(markdown: bool, options: Options) -> int:
    """Print the JSON schema of case files, for editors, or all keys for people."""
    from geoident.workflow.schema import key_page, schema

    click.echo(key_page() if markdown else schema(), nl=False)
    return 0
