"""Dask cluster whose workers are killed at random."""

from __future__ import annotations

import os
import random
import signal
import threading
from typing import Any

from distributed import Status


class Killer(threading.Thread):
    """Kill random workers at intervals, as an operating system does when memory runs out.

    Only running workers are killed, because the nanny does not restart a worker that dies during its start, and finally no worker
    would be left.
    """

    def __init__(self, cluster: Any, every: float, most: int = 3) -> None:
        super().__init__(daemon=True)
        # The maximum number of kills ensures progress on a busy machine, where workers may be killed faster than they start.
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
