"""Dask cluster whose workers are killed at random."""

from __future__ import annotations

import os
import random
import signal
import threading
from typing import Any

from distributed import Status


class Killer(threading.Thread):
    """Kill a random worker from time to time, like an operating system that runs out of memory.

    Only running workers are killed: the nanny gives up on a worker that dies during its start, until no worker is left.
    """

    def __init__(self, cluster: Any, every: float, most: int = 8) -> None:
        super().__init__(daemon=True)
        # The limit ensures progress on a busy machine, where a worker may take longer to start than to be killed.
        self.cluster, self.every, self.most = cluster, every, most
        self.kills, self.done = 0, threading.Event()

    def run(self) -> None:
        chance = random.Random(20)
        # The first kill comes early, because the render may be short.
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
