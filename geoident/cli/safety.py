"""``--safety`` of two commands: what they say of factors of safety, and the picture beside it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import click

from geoident.cli.options import Options
from geoident.cli.signals import stop_on_signals
from geoident.cli.terminal import Terminal
from geoident.errors import ExitCode, GeoidentError
from geoident.report.text.json import dumps
from geoident.report.text.safety import safety_object, safety_text
from geoident.workflow.running.control import Control
from geoident.workflow.running.outputs import target
from geoident.workflow.running.remade import write_remade
from geoident.workflow.safety import Safety, SafetyRequest


def say_safety(
    asked: SafetyRequest, compute: Callable[[SafetyRequest, Control], Safety], options: Options
) -> int:
    """Compute factors of safety and say them: sentences or JSON on stdout.

    Args:
        asked: what is asked.
        compute: of a case or of a fit.
        options: of the command.

    Returns:
        The exit code.
    """
    terminal = Terminal(options)
    control = Control(terminal, jobs=options.jobs)
    with terminal.live(asked.path), stop_on_signals(control.stop):
        found = compute(asked, control)
    code = ExitCode.DONE if found.status == "done" else ExitCode.NOT_CONVERGED
    if options.as_json:
        about = safety_object(
            found.rows,
            found.names,
            case=asked.path,
            output=asked.fields,
            result=None if found.finished is None else found.finished.paths[0],
            status=found.status,
            exit_code=int(code),
        )
        click.echo(dumps(about))
    else:
        click.echo(safety_text(found.rows, found.names, poor=found.poor))
    if found.finished is not None:
        stands = "up to date" if found.finished.up_to_date else "also written"
        for line in (f"{stands}: {found.finished.paths[0]}", *found.finished.remarks):
            terminal.inform(line)
    if asked.fields is not None:
        terminal.inform(f"also written: {asked.fields}")
    if picture := _drawn(found, options):
        terminal.inform(picture)
    return int(code)


def _drawn(found: Safety, options: Options) -> str:
    """A line that names the picture of the mechanism, or says why there is none."""
    if found.mechanism is None:
        return ""

    try:
        from geoident.report.drawing.fields.mechanism import mechanism_picture  # noqa: PLC0415
        from geoident.report.drawing.style import image  # noqa: PLC0415 - matplotlib is an extra
    except ImportError:
        return "A picture of the mechanism needs matplotlib: pip install 'geoident[report]'."
    place: Path = target(found.path, "safety").path.with_suffix(".png")
    picture = mechanism_picture(found.mechanism, ("x", "y", "z"), found.critical.upper)
    try:
        write_remade(
            {str(place): image(picture, "png")},
            cases=[found.path],
            force=options.force,
            inputs=found.files_read,
        )
    except (GeoidentError, OSError) as reason:
        return f"The mechanism is not drawn: {str(reason).splitlines()[0]}"
    return f"The mechanism, as a picture: {place}"
