"""The page of all commands, made from the commands themselves."""

from __future__ import annotations

import re
from inspect import cleandoc

import click

from geoident.cli.app import COMMANDS, geoident
from geoident.errors import ExitCode
from geoident.io.docs.key_page import wrapped

HEAD = """\
# Commands

Made from the commands; `geoident COMMAND --help` prints the same. Each command ends with suggested
next steps.

Results (paths, tables, JSON) go to the standard output. Progress, remarks and errors go to the
standard error, so a program that reads `geoident show case.fit.h5 --json` gets the JSON alone.
Files are written whole or not at all. No output ever replaces an input of its command, also not
through a link.

| command | what it does |
|---|---|"""

EXIT_CODES = {
    ExitCode.DONE: "done (also: already up to date)",
    ExitCode.BUG: "a bug in geoident: the message names the log file (for `diff`: the results "
    "differ; a bug is 70)",
    ExitCode.USAGE: "wrong flags",
    ExitCode.INVALID_INPUT: "invalid input: case, mesh, readings",
    ExitCode.NOT_CONVERGED: "the result is written, but not converged, not determined, poorly "
    "fitted or out of budget; for `backtest`: the bands do not hold",
    ExitCode.NO_SOLUTION: "the model has no solution: a mechanism, or plastic collapse (picture "
    "CASE.collapse.png)",
    ExitCode.OUTPUT: "output exists from other input, no permission, disk full",
    ExitCode.SOME_FAILED: "some of several cases, or of the runs of a campaign, failed",
    ExitCode.ALARM: "an alarm: `control` sees a change of a gauge or of the structure, wrong "
    "readings, or a reached alarm value; the result is written",
    ExitCode.INTERRUPTED: "interrupted; the same command continues from the checkpoint",
    ExitCode.TERMINATED: "terminated from outside; the same command continues",
}


def command_page() -> str:
    """The text of ``commands.md``."""
    context = click.Context(geoident, info_name="geoident")
    commands = [_command(name) for name in COMMANDS]
    rows = [f"| [`geoident {c.name}`](#geoident-{c.name}) | {_first(c)} |" for c in commands]
    parts = [_part(command, context) for command in commands]
    return "\n".join([HEAD, *rows, "", _exit_codes(), *parts])


def _command(name: str) -> click.Command:
    found = geoident.get_command(click.Context(geoident), name)
    assert found is not None
    found.name = name
    return found


def _first(command: click.Command) -> str:
    return _text(command).partition("\n\n")[0].replace("\n", " ").rstrip(".")


def _text(command: click.Command) -> str:
    return cleandoc(command.help or "")


def _exit_codes() -> str:
    rows = [f"| {code.value} | {EXIT_CODES[code]} |" for code in ExitCode]
    return "\n".join(["## Exit codes", "", "| code | meaning |", "|---|---|", *rows, ""])


def _part(command: click.Command, parent: click.Context) -> str:
    context = click.Context(command, info_name=command.name, parent=parent)
    usage = f"geoident {command.name} {' '.join(command.collect_usage_pieces(context))}"
    lines = [f"## geoident {command.name}", "", "```text", usage, "```", ""]
    lines += [_paragraphs(_text(command)), ""]
    options = [p for p in command.params if isinstance(p, click.Option)]
    if options:
        lines += [*(_option(option, context) for option in options), ""]
    lines += _epilog(command)
    return "\n".join(lines)


def _paragraphs(text: str) -> str:
    """Paragraphs as help shows them; lines behind a backspace are kept."""
    found = []
    for paragraph in re.split(r"\n{2,}", text):
        if paragraph.startswith("\b\n"):
            found.append(f"```text\n{paragraph[2:]}\n```")
        else:
            found.append(wrapped(_escaped(paragraph)))
    return "\n\n".join(found)


def _option(option: click.Option, context: click.Context) -> str:
    names, about = option.get_help_record(context) or ("", "")
    return wrapped(f"- `{names}`: {_escaped(about)}", "  ")


def _escaped(text: str) -> str:
    return text.replace("|", "\\|").replace("<", "\\<").replace("*", "\\*")


def _epilog(command: click.Command) -> list[str]:
    """Examples as a block, what follows them as text."""
    lines: list[str] = []
    for part in re.split(r"\n{2,}", cleandoc(command.epilog or "")):
        title, _, body = part.removeprefix("\b\n").strip("\b\n").partition("\n")
        if not body:
            lines += [wrapped(_escaped(title)), ""]
        elif title.endswith(":"):
            lines += [title, "", "```text", cleandoc("\n" + body), "```", ""]
        else:
            lines += ["```text", f"{title}\n{body}", "```", ""]
    return lines
