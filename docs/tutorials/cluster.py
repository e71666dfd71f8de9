# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: percent
#       format_version: '1.3'
#   kernelspec:
#     name: python3
#     display_name: Python 3
# ---

# %% [markdown]
# # A cluster
#
# One render on many processes or machines, workers that die, and the same bytes in the end. Dask schedules; here its cluster is two
# processes of this machine. On a real one only the line that makes the cluster is another:
#
# ```python
# from dask_jobqueue import SLURMCluster
#
# cluster = SLURMCluster(cores=1, memory="2GB", walltime="04:00:00")
# cluster.adapt(maximum=256)
# ```

# %%
import json
import os
import signal
import tempfile
import threading
from pathlib import Path

import distributed as dask
import numpy as np
import pysunstone as ps
from pysunstone import distributed

ROOT = next(folder for folder in [Path.cwd(), *Path.cwd().parents] if (folder / "scenes").is_dir())
SCENE = ROOT / "scenes/mirror_room/scene.toml"
folder = Path(tempfile.mkdtemp())

cluster = dask.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=":0")
client = cluster.get_client()
cluster

# %% [markdown]
# A render is cut into parts by tiles of its image. Each part is a pure function of scene, seed and samples, so it does not matter which
# worker makes it, when, or how often. To show it, a worker is killed while they render.

# %%
processes = client.run(os.getpid)
death = threading.Timer(1.0, os.kill, [next(iter(processes.values())), signal.SIGKILL])
death.start()
whole = distributed.render(SCENE, folder / "room.zarr", spp=8, parts=12, slices=["polarimetric", "xt"], client=client)
death.join()
client.wait_for_workers(2)
sorted(processes.values()), sorted(client.run(os.getpid).values())

# %% [markdown]
# On this process alone, without a cluster, the numbers are the same to the bit:

# %%
alone = ps.Scene.load(SCENE).render(spp=8, slices=["polarimetric", "xt"])
together = ps.open_store(whole)
for name, node in together.children.items():
    assert np.array_equal(node["mean"].values, alone[name]["mean"], equal_nan=True), name
sorted(together.children)

# %% [markdown]
# ## Many scenes, variants or seeds
#
# A data set is many renders, each whole on one worker, with a manifest that says what each is.

# %%
jobs = [distributed.Job(SCENE, seed=seed, spp=1, slices=["polarimetric"]) for seed in (1, 2, 3)]
manifest = distributed.render_many(jobs, folder / "set", client=client)
[{key: entry[key] for key in ("store", "seed", "samples_per_pixel")} for entry in json.loads(manifest.read_text())]

# %% [markdown]
# Seeds are independent, so the scatter between them is the true error of one:

# %%
images = np.stack([ps.open_store(folder / "set" / entry["store"])["polarimetric"]["mean"].values for entry in json.loads(manifest.read_text())])
assert len({image.tobytes() for image in images}) == len(jobs)
images.std(axis=0, ddof=1).shape

# %%
client.close()
cluster.close()

# %% [markdown]
# Without Python, `sunstone render --part 3/64` and `sunstone merge` do the same: see [many machines](../clusters.md), with an array job of
# SLURM.
