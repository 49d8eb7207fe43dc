"""``geoident schema``."""

from __future__ import annotations

import click

from geoident.cli.options import Arguments, Options, Steps, takes

EPILOG = """\b
Examples:
  geoident schema > case.schema.json
  geoident schema --markdown | less
  geoident schema --campaign > campaign.schema.json
  geoident schema --project > project.schema.json

\b
An editor with a YAML language server completes and checks a case whose
first line is
  # yaml-language-server: $schema=case.schema.json
"""


def _next(arguments: Arguments, options: Options) -> Steps:
    if arguments["markdown"]:
        return ()
    what = next((kind for kind in ("campaign", "project") if arguments[kind]), "case")
    return (f"write in the first line of a {what}: # yaml-language-server: $schema=FILE",)


@click.command(epilog=EPILOG)
@click.option("--markdown", is_flag=True, help="The page of all keys, for people.")
@click.option("--campaign", is_flag=True, help="Of campaign files in place of cases.")
@click.option("--project", is_flag=True, help="Of project files in place of cases.")
@takes(after=_next)
def command(markdown: bool, campaign: bool, project: bool, options: Options) -> int:
    """Print the JSON schema of case files, for editors, or all keys for people."""
    if campaign and project:
        raise click.UsageError("--campaign and --project exclude each other.")
    if project:
        from geoident.io.docs.project_schema import project_key_page_text, project_schema_text

        click.echo(project_key_page_text() if markdown else project_schema_text(), nl=False)
        return 0
    if campaign:
        from geoident.io.docs.campaign_schema import campaign_key_page_text, campaign_schema_text

        click.echo(campaign_key_page_text() if markdown else campaign_schema_text(), nl=False)
        return 0
    from geoident.io.docs.case_schema import case_schema_text, key_page_text

    click.echo(key_page_text() if markdown else case_schema_text(), nl=False)
    return 0
