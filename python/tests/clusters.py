"""Workers of a Dask cluster that die at random."""

from __future__ import annotations

import os
import random
import signal
import threading
from typing import Any

from distributed import Status


class Killer(threading.Thread):
    """Kills a random worker every now and then, as the system does that wants its memory.

    Only those that run: one that dies while it starts is given up by the process that watches it, until no worker is left.
    """

    def __init__(self, cluster: Any, every: float, most: int = 8) -> None:
        super().__init__(daemon=True)
        # Where the machine is so busy that a worker takes longer to start than it lives, nothing would ever end.
        self.cluster, self.every, self.most = cluster, every, most
        self.kills, self.done = 0, threading.Event()

    def run(self) -> None:
        chance = random.Random(20)
        # The first one soon: what is rendered may not take long.
        while self.kills < self.most and not self.done.wait(self.every * chance.uniform(0.5, 1.5) / (1 if self.kills else 4)):
            nannies = [nanny for nanny in self.cluster.workers.values() if nanny.status == Status.running]
            pids = [nanny.pid for nanny in nannies if nanny.process is not None and nanny.process.status == Status.running and nanny.pid]
            if pids:
                try:
                    os.kill(chance.choice(pids), signal.SIGKILL)
                    self.kills += 1
                except ProcessLookupError:
                    pass

    def __enter__(self) -> Killer:
        self.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.done.set()
        self.join()
