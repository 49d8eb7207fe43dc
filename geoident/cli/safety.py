"""``--safety`` of two commands: what they say of factors of safety, and the picture beside it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import click

from geoident.cli.options import Options
from geoident.cli.signals import stop_on_signals
from geoident.cli.terminal import Terminal
from geoident.errors import GeoidentError
from geoident.report.text.json import dumps
from geoident.report.text.safety import safety_object, safety_text
from geoident.workflow.running.control import Control
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
    with terminal.live(asked.request.case), stop_on_signals(control.stop):
        found = compute(asked, control)
    result, paths = found.result, found.finished.paths
    if options.as_json:
        about = safety_object(result, case=asked.request.case, path=paths[0])
        click.echo(dumps(about))
    else:
        click.echo(safety_text(result))
    stands = "up to date" if found.finished.up_to_date else "also written"
    for line in (f"{stands}: {paths[0]}", *found.finished.remarks):
        terminal.inform(line)
    if picture := _drawn(found, asked.request.case, options):
        terminal.inform(picture)
    return int(result.exit_code)


def _drawn(found: Safety, case: str, options: Options) -> str:
    """A line that names the picture of the mechanism, or says why there is none."""
    mechanism = found.result.mechanism
    if mechanism is None:
        return ""
    try:
        from geoident.report.drawing.fields.mechanism import mechanism_picture  # noqa: PLC0415
        from geoident.report.drawing.style import image  # noqa: PLC0415 - matplotlib is an extra
    except ImportError:
        return "A picture of the mechanism needs matplotlib: pip install 'geoident[report]'."
    place = Path(found.finished.paths[0]).with_suffix(".png")
    picture = mechanism_picture(mechanism, ("x", "y", "z"), found.critical.upper)
    try:
        write_remade(
            {str(place): image(picture, "png")},
            cases=[case],
            force=options.force,
            inputs=found.files_read,
        )
    except (GeoidentError, OSError) as reason:
        return f"The mechanism is not drawn: {str(reason).splitlines()[0]}"
    return f"The mechanism, as a picture: {place}"
