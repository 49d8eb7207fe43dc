"""``geoident watch``."""

from __future__ import annotations

import click

from geoident.cli.options import Duration, Options, always, takes

EPILOG = """\b
Examples:
  geoident watch tunnel.yaml --every 10min
  geoident watch site/ --every 1h --json >> site.jsonl 2>> site.log
  geoident watch site/ --once || echo look at it
  geoident watch tunnel.yaml --trust --on-alarm "mail me@example.org"
"""


@click.command(epilog=EPILOG)
@click.argument("path", metavar="CASE|FOLDER", type=click.Path(exists=True))
@click.option(
    "--every",
    type=Duration(),
    default="10min",
    show_default=True,
    help="Time from one look to the next.",
)
@click.option("--once", is_flag=True, help="Look once and end, as for cron.")
@click.option(
    "--on-alarm",
    metavar="CMD",
    help="Program to run when a new alarm appears, with the JSON object of the result on its "
    "stdin; not by a shell. Needs --trust. It is run again at the next look if it fails.",
)
@takes("as_json", "trust", after=always())
def command(path: str, every: float, once: bool, on_alarm: str | None, options: Options) -> int:
    """Update cases as their files grow, until it is stopped.

    Whenever the case or a file that it names has changed, new readings are judged and fitted in as
    `update` does; those of a structure in service that was fitted are held against the fit as
    `control` does. A file that is half written waits; one that cannot be read is reported, and the
    last good result stays. Prints the path of each new result, with --json its object on a line;
    what happens, with times, goes to stderr.
    """
    from geoident.cli.jobs import run_watch

    return run_watch(path, options, every=None if once else every, on_alarm=on_alarm)
