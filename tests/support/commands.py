"""Running commands inside the process of the tests."""

from collections.abc import Mapping
from typing import Any

from click.testing import CliRunner, Result

from geoident.cli.app import geoident
from geoident.io.case import file  # imported once: else by each process that reads a case beside

__all__ = ["file", "run_command", "said_findings"]


def run_command(*arguments, stdin=None) -> Result:
    """What a command said, and its exit code."""
    return CliRunner().invoke(geoident, [str(a) for a in arguments], input=stdin)


def said_findings(found: Mapping[str, Any]) -> list[str]:
    """The sentences of the findings of a result that ``--json`` printed."""
    return [finding["sentence"] for finding in found["findings"]]
