"""What a command does when a signal comes, without a process that is ended by one."""

import signal

import pytest

from geoident.cli.signals import CODES, stop_on_signals, stop_runs_on_signals
from geoident.errors import ExitCode


class Runs:
    """Remembers what it was asked."""

    def __init__(self):
        self.asked = []

    def ask(self, code):
        self.asked.append(code)

    def ask_to_stop(self):
        self.asked.append("stop")

    def kill(self):
        self.asked.append("kill")


@pytest.mark.parametrize(
    ("number", "code"),
    [(signal.SIGINT, ExitCode.INTERRUPTED), (signal.SIGTERM, ExitCode.TERMINATED)],
)
def test_the_first_signal_asks_and_the_second_is_left_to_the_system(number, code, capfd):
    before = {one: signal.getsignal(one) for one in CODES}
    runs = Runs()
    with stop_on_signals(runs):
        signal.raise_signal(number)
        assert runs.asked == [code]
        assert signal.getsignal(number) is signal.SIG_DFL
    assert "a second signal stops at once" in capfd.readouterr().err
    assert {one: signal.getsignal(one) for one in CODES} == before


def test_many_runs_are_asked_first_and_then_ended(capfd):
    runs = Runs()
    with stop_runs_on_signals(runs) as heard:
        assert heard.code is None
        signal.raise_signal(signal.SIGTERM)
        signal.raise_signal(signal.SIGINT)
        assert runs.asked == ["stop", "kill"]
    assert heard.code == ExitCode.TERMINATED
    assert capfd.readouterr().err.count("a second signal") == 1
