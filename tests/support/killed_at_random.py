"""Processes that answer tasks while one after the other is killed: python -m ... HOW_MANY.

Prints as JSON how many were killed, the answers, the number of losses and all processes.
"""

import json
import os
import random
import sys
import threading
import time
from contextlib import suppress

from geoident.workflow.executing.executor import in_order
from geoident.workflow.executing.processes import LocalProcesses
from tests.support.tasks import squares


class _Killer(threading.Thread):
    def __init__(self, processes, kills):
        super().__init__(daemon=True)  # what goes wrong with who asks does not wait for it
        self.processes = processes
        self.kills = kills
        self.killed = 0
        self.seen = set()
        self.ready = set()

    def run(self):
        chance = random.Random(self.kills)
        while self.killed < self.kills:
            time.sleep(chance.uniform(0.02, 0.3))
            self.seen.update(self.processes.processes)
            # those that are still starting have no task to lose, and a busy machine starts slowly
            pids = [pid for pid in self.processes.processes if pid in self.ready]
            with suppress(ProcessLookupError):  # it was reaped a moment ago
                if pids:
                    os.kill(chance.choice(pids), 9)
                    self.killed += 1


def main(kills):
    with LocalProcesses(2, squares, retries=1000) as processes:
        killer = _Killer(processes, kills)

        def tasks():
            number = 0
            while killer.is_alive() or number < 100:
                yield number
                number += 1

        killer.start()
        found = []
        for answer in in_order(processes.run(tasks())):
            found.append(answer)
            killer.ready.add(answer.value[1])
        killer.seen.update(processes.processes)
    told = {
        "killed": killer.killed,
        "answers": [answer.value[0] for answer in found],
        "losses": sum(len(answer.losses) for answer in found),
        "processes": sorted(killer.seen),
    }
    json.dump(told, sys.stdout)


if __name__ == "__main__":
    main(int(sys.argv[1]))
