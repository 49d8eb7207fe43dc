"""Running commands inside the process of the tests."""

from click.testing import CliRunner, Result

from geoident.cli.app import geoident
from geoident.io.case import file  # imported once: else by each process that reads a case beside

__all__ = ["file", "run_command"]


def run_command(*arguments, stdin=None) -> Result:
    """What a command said, and its exit code."""
    return CliRunner().invoke(geoident, [str(a) for a in arguments], input=stdin)
