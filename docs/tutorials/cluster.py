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
# This tutorial distributes one render over several processes with Dask. The result is bit-identical, even if workers die. Here, the
# cluster is two processes of this machine. On a real cluster, only the lines that make the cluster differ:
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
# A render is split into parts by tiles of its image. Each part is a pure function of scene, seed and samples, so the result does not
# depend on which worker renders it, when, or how often. To show this, the next cell kills a worker during the render.

# %%
processes = client.run(os.getpid)
death = threading.Timer(1.0, os.kill, [next(iter(processes.values())), signal.SIGKILL])
death.start()
whole = distributed.render(SCENE, folder / "room.zarr", spp=8, parts=12, slices=["polarimetric", "xt"], client=client)
death.join()
client.wait_for_workers(2)
sorted(processes.values()), sorted(client.run(os.getpid).values())

# %% [markdown]
# In this process alone, without a cluster, the result is bit-identical:

# %%
alone = ps.Scene.load(SCENE).render(spp=8, slices=["polarimetric", "xt"])
together = ps.open_store(whole)
for name, node in together.children.items():
    assert np.array_equal(node["mean"].values, alone[name]["mean"], equal_nan=True), name
sorted(together.children)

# %% [markdown]
# ## Many scenes, variants or seeds
#
# A data set consists of many renders, each completely on one worker, and a manifest that describes them.

# %%
jobs = [distributed.Job(SCENE, seed=seed, spp=1, slices=["polarimetric"]) for seed in (1, 2, 3)]
manifest = distributed.render_many(jobs, folder / "set", client=client)
[{key: entry[key] for key in ("store", "seed", "samples_per_pixel")} for entry in json.loads(manifest.read_text())]

# %% [markdown]
# Seeds are independent, so the standard deviation over seeds is the true error of one render:

# %%
images = np.stack([ps.open_store(folder / "set" / entry["store"])["polarimetric"]["mean"].values for entry in json.loads(manifest.read_text())])
assert len({image.tobytes() for image in images}) == len(jobs)
images.std(axis=0, ddof=1).shape

# %%
client.close()
cluster.close()

# %% [markdown]
# Without Python, `sunstone render --part 3/64` and `sunstone merge` do the same. See [many machines](../clusters.md) for a SLURM array
# job.
