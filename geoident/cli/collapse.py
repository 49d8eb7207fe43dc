"""The mechanism of a collapse as a picture beside the case, where a command ends by it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from geoident.cli.options import Options
from geoident.errors import CollapseError, GeoidentError
from geoident.model.results.yielded import Mechanism
from geoident.workflow.running.outputs import target
from geoident.workflow.running.remade import write_remade


@contextmanager
def mechanism_drawn(case: str, options: Options) -> Iterator[None]:
    """Where a stage collapses, its mechanism is drawn, and the message says where.

    Args:
        case: path of the case.
        options: of the command.
    """
    try:
        yield
    except CollapseError as error:
        drawn = _drawn(error, case, options)
        if drawn:
            error.add(drawn)
        raise


def _drawn(error: CollapseError, case: str, options: Options) -> str:
    """A line that names the picture, or says why there is none; empty where nothing is known."""
    motion = error.motion
    if not isinstance(motion, Mechanism):
        return ""
    try:
        from geoident.report.drawing.fields.mechanism import mechanism_picture  # noqa: PLC0415
        from geoident.report.drawing.style import image  # noqa: PLC0415 - matplotlib is an extra
    except ImportError:
        return "A picture of the mechanism needs matplotlib: pip install 'geoident[report]'."
    name = target(case, "collapse").path.with_suffix(".png")
    inputs = [] if case == "-" else [case]
    picture = mechanism_picture(motion, ("x", "y", "z"))
    try:
        write_remade({str(name): image(picture, "png")}, cases=[case], force=options.force,
                     inputs=inputs)  # fmt: skip
    except (GeoidentError, OSError) as reason:
        return f"The mechanism is not drawn: {str(reason).splitlines()[0]}"
    return f"The mechanism, as a picture: {Path(name)}"
