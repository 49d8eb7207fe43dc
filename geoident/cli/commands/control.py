"""``geoident control``."""

from __future__ import annotations

import click

from geoident.cli.options import Arguments, Options, Steps, on_result, result_of, takes

EPILOG = """\b
Examples:
  geoident control dam.fit.h5 --readings new.csv
  geoident control dam.fit.h5 --false-alarms "1 per 5 years" --json
  geoident control dam.fit.h5 --power "P2 drifts 1 mm/year"
  geoident control dam.fit.h5 -q || echo alarm | mail -s dam me@example.org
"""


def _next(arguments: Arguments, options: Options) -> Steps:
    return on_result(result_of("control", arguments["result"], options))


@click.command(epilog=EPILOG)
@click.argument("result", metavar="RESULT", type=click.Path())
@click.option(
    "--readings",
    metavar="NEW",
    type=click.Path(),
    help="File of new readings, laid out as that of the case; by default those of the case that "
    "are later than the fit.",
)
@click.option(
    "--false-alarms",
    metavar="RATE",
    default="1 per 10 years",
    show_default=True,
    help="How often chance alone may raise an alarm, of all gauges together.",
)
@click.option(
    "--power",
    metavar="CHANGE",
    multiple=True,
    help="Tell whether a change would be seen, and how late: 'P2 drifts 1 mm/year', 'P1, P2 step "
    "2 mm', 'all soften 20 %', on a mesh 'E_rock falls 20 %'; may be repeated. Needs no new "
    "readings.",
)
@click.option(
    "--on-alarm",
    metavar="CMD",
    help="Program to run when a new alarm is found, with the JSON object of the result on its "
    "stdin; not by a shell. Needs --trust.",
)
@takes("output", "seed", "force", "fresh", "as_json", "trust", after=_next)
def command(
    result: str,
    readings: str | None,
    false_alarms: str,
    power: tuple[str, ...],
    on_alarm: str | None,
    options: Options,
) -> int:
    """Hold new readings of a structure in service against its fit.

    Each reading is judged before it is used. Steps and drifts are looked for, of single gauges and
    of several at once, on a mesh also changes of its parameters, with the date at which they began.
    The state is green; amber where the last readings show that a gauge has changed; red where the
    structure has, or an alarm value is reached. Single wrong readings are named, and over with the
    next. Amber and red end with exit code 8. Writes RESULT.control.h5 and prints its path.
    """
    from geoident.cli.error_boundary import failures_as_json
    from geoident.cli.jobs import run_control
    from geoident.workflow.in_service.control import ControlRequest, time_between

    with failures_as_json(result, options):
        request = ControlRequest(
            result=result,
            readings=readings,
            false_alarms=time_between(false_alarms),
            power=power,
            output=options.output,
            seed=options.seed,
            force=options.force,
            fresh=options.fresh,
        )
        return run_control(request, options, on_alarm=on_alarm)
