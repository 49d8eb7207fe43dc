"""``geoident simulate``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from geoident.cli.error_boundary import failures_as_json
from geoident.cli.options import (
    Arguments,
    Options,
    Steps,
    asks_safety,
    line,
    new_name,
    on_result,
    overrides,
    result_of,
    takes,
)
from geoident.errors import UsageError

if TYPE_CHECKING:
    from geoident.workflow.simulate import Simulated

EPILOG = """\b
Examples:
  geoident simulate case.yaml
  geoident simulate case.yaml --set parameters.E_rock.start="20 GPa"
  geoident simulate case.yaml --values parameters.csv
  geoident simulate case.yaml --reduced case.fit.h5
  geoident simulate case.yaml --noise --seed 1 -o simulated.csv
  geoident simulate case.yaml --draw --seed 3
  geoident simulate case.yaml --fields case.vtkhdf > simulated.csv
  geoident simulate case.yaml --safety --at "bench 3"
  geoident simulate case.yaml --dakota params.in results.out
"""


def _next(arguments: Arguments, options: Options) -> Steps:
    case, file = arguments["case"], options.output
    if arguments["dakota"]:
        return ()
    if arguments["safety"]:
        return on_result(result_of("safety", case, options))
    if file in (None, "-"):
        words = (*overrides(options), *_drawn(arguments, options))
        return (line("simulate", case, *words, "-o", new_name("simulated", ".csv")),)
    from geoident.io.text.text_file import seen_from

    readings = seen_from(Path(case).parent, file)
    return (line("fit", case, "--set", f"readings={readings}"),)


def _drawn(arguments: Arguments, options: Options) -> Steps:
    """The words that make the same random numbers once more."""
    chosen = [name for name in ("noise", "draw") if arguments[name]]
    seed = ("--seed", str(options.seed)) if chosen and options.seed else ()
    values = ("--values", str(arguments["values"])) if arguments["values"] else ()
    return (*values, *(f"--{name}" for name in chosen), *seed)


@click.command(epilog=EPILOG)
@click.argument("case", metavar="CASE", type=click.Path())
@click.option(
    "--values",
    metavar="FILE",
    type=click.Path(),
    help="Take parameters from a table parameter,value,unit, not from their starts.",
)
@click.option("--noise", is_flag=True, help="Add Gaussian noise of each gauge's accuracy.")
@click.option(
    "--draw",
    is_flag=True,
    help="Draw what varies from place to place (fields) by --seed; else fields have their means.",
)
@click.option(
    "--fields",
    metavar="FILE.vtkhdf",
    type=click.Path(),
    help="Also write displacements, stresses and principal stresses of all states, for ParaView; "
    "structures, shells and interfaces beside it, as FILE.shells.vtkhdf.",
)
@click.option(
    "--dakota",
    nargs=2,
    metavar="PARAMS RESULTS",
    type=click.Path(),
    help="Compute what Dakota's file PARAMS requests and write RESULTS.",
)
@takes(
    "output", "overrides", "seed", "solver", "reduced", "force", "as_json", "trust",
    after=_next,
)  # fmt: skip
@asks_safety
def command(
    case: str,
    values: str | None,
    noise: bool,
    draw: bool,
    fields: str | None,
    dakota: tuple[str, str] | None,
    safety: tuple[str, ...] | None,
    options: Options,
) -> int:
    """Compute what the gauges would read at the start values of the parameters.

    Prints lines gauge,stage,value,unit, that a case can use as readings. With -o into a file,
    which says that they are simulated; earlier ones of the case are kept beside (FILE.1.csv).
    """
    from geoident.cli.collapse import mechanism_drawn
    from geoident.workflow.simulate import ComputedBy, Noise, Outputs, simulate

    if dakota is not None:
        others = {
            "--noise": noise,
            "--draw": draw,
            "--fields": fields,
            "--safety": safety is not None,
        }
        return _answer(case, dakota, _refused_with_dakota(values, others, options))
    if safety is not None:
        others = {"--noise": noise, "--draw": draw, "--fields": fields}
        return _safety(case, safety, values, others, options)
    file = None if options.output == "-" else options.output
    with failures_as_json(case, options), mechanism_drawn(case, options):
        simulated = simulate(
            case,
            overrides=options.overrides,
            noise=Noise.ACCURACY if noise else Noise.NONE,
            draw=draw,
            seed=options.seed,
            by=ComputedBy(options.solver, options.reduced, values),
            to=Outputs(file, fields, options.force),
        )
        if fields is not None and not options.quiet:
            for path in simulated.written:
                click.echo(f"also written: {path}", err=True)
        if simulated.note and not options.quiet:
            click.echo(simulated.note, err=True)
        _say(simulated, case, options)
    return 0


def _refused_with_dakota(values: str | None, others: dict[str, Any], options: Options) -> Options:
    """The options of an answer to Dakota, which takes no others."""
    given = {"--values": values, **others, "-o": options.output, "--json": options.as_json}
    if named := [name for name, value in given.items() if value]:
        raise UsageError(f"{named[0]} does not go with --dakota, whose files define these")
    return options


def _safety(
    case: str,
    stages: tuple[str, ...],
    values: str | None,
    others: dict[str, Any],
    options: Options,
) -> int:
    """Factors of safety in place of readings."""
    from geoident.cli.collapse import mechanism_drawn
    from geoident.cli.jobs import request_of
    from geoident.cli.safety import say_safety
    from geoident.workflow.safety import SafetyRequest, safety_of_case

    given = {**others, "--reduced": options.reduced}
    if named := [name for name, value in given.items() if value]:
        raise UsageError(
            f"{named[0]} does not go with --safety, which computes no readings; ParaView opens "
            "what it writes by CASE.safety.vtkhdf"
        )
    with failures_as_json(case, options), mechanism_drawn(case, options):
        asked = SafetyRequest(request_of(case, options), stages, values)
        return say_safety(asked, safety_of_case, options)


def _answer(case: str, files: tuple[str, str], options: Options) -> int:
    from geoident.workflow.bridges.dakota import answer
    from geoident.workflow.simulate import ComputedBy

    by = ComputedBy(options.solver, options.reduced)
    answer(case, *files, overrides=options.overrides, by=by, force=options.force)
    return 0


def _say(simulated: Simulated, case: str, options: Options) -> None:
    """The readings to stdout or to a file; with a file, its path to stdout."""
    from geoident.report.text.gauges import readings_csv
    from geoident.report.text.json import dumps, simulation_object
    from geoident.workflow.running.remade import write_readings

    readings, channels = simulated.readings, simulated.case.channels
    file = None if options.output in (None, "-") else options.output
    if file is not None:
        text, inputs = readings_csv(readings, channels), simulated.files_read
        kept = write_readings(text, file, case=case, force=options.force, inputs=inputs)
        if kept is not None and not options.quiet:
            message = f"{file} was simulated with another state of the case: it is kept as {kept}"
            click.echo(message, err=True)
    if options.as_json:
        click.echo(dumps(simulation_object(readings, channels, case=case, output=file)))
    elif file is not None:
        click.echo(file)
    else:
        click.echo(readings_csv(readings, channels), nl=False)
