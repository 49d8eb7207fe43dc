"""``geoident batch --cluster`` as a command: Ctrl-C, and a cluster that is not there."""

import os
import signal
from contextlib import suppress

import pytest

from geoident.workflow.campaign.runs import read_runs
from tests.cli.test_batch import begin, ended, here, on_linux
from tests.support.real_cluster import marked, wait_until

__all__ = ["here"]


@pytest.mark.slow  # without a cluster: `test_batch`
@on_linux
def test_ctrl_c_ends_a_cluster_of_this_machine_with_what_is_kept(here):
    process, mark = begin("--cluster", "local", "-j", "1")
    wait_until(lambda: ended() >= 2)
    for pid in marked(mark):  # as a terminal does
        with suppress(ProcessLookupError):
            os.kill(pid, signal.SIGINT)
    _, stderr = process.communicate(timeout=60)
    assert process.returncode == 130
    assert "have not ended; the same command continues" in stderr
    wait_until(lambda: not marked(mark), 20.0)
    assert 2 <= len(read_runs("campaign.batch").runs) < 24


@pytest.mark.parametrize("command", [["batch", "campaign.yaml"], ["fit", "case.yaml"],
                                     ["scan", "case.yaml"]], ids=" ".join)  # fmt: skip
def test_a_word_that_is_no_cluster_is_refused(here, run, command):
    failed = run(*command, "--cluster", "nowhere")
    assert failed.exit_code == 3
    assert (
        "--cluster: 'nowhere' is not an address, and there is no file of that name" in failed.stderr
    )
