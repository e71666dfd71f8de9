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
# # Render on a cluster
#
# This tutorial distributes one render over several processes with Dask. The result is bit-identical to that of a single process, even if
# workers are killed. In this tutorial, the cluster consists of two processes on one machine. For a real cluster, replace only the lines
# that create the cluster, for example by:
#
# ```python
# from dask_jobqueue import SLURMCluster
#
# cluster = SLURMCluster(cores=1, memory="2GB", walltime="04:00:00")
# cluster.adapt(maximum=256)
# ```
#
# Install the packages of this tutorial with `pip install "./python[stores,dask]"`.

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
# A render is split into parts, which are sets of image tiles. Each part is a pure function of the scene, the seed and the number of
# samples, so the result does not depend on which worker renders a part, when, or how often. To test this, the next cell kills a worker
# during the render.

# %%
processes = client.run(os.getpid)
death = threading.Timer(1.0, os.kill, [next(iter(processes.values())), signal.SIGKILL])
death.start()
whole = distributed.render(SCENE, folder / "room.zarr", spp=8, parts=12, slices=["polarimetric", "xt"], client=client)
death.join()
client.wait_for_workers(2)
sorted(processes.values()), sorted(client.run(os.getpid).values())

# %% [markdown]
# A render in a single process, without a cluster, gives a bit-identical result:

# %%
alone = ps.Scene.load(SCENE).render(spp=8, slices=["polarimetric", "xt"])
together = ps.open_store(whole)
for name, node in together.children.items():
    assert np.array_equal(node["mean"].values, alone[name]["mean"], equal_nan=True), name
sorted(together.children)

# %% [markdown]
# ## Many scenes, variants or seeds
#
# A data set consists of many renders and a manifest that describes them. Each render runs completely on one worker.

# %%
jobs = [distributed.Job(SCENE, seed=seed, spp=1, slices=["polarimetric"]) for seed in (1, 2, 3)]
manifest = distributed.render_many(jobs, folder / "set", client=client)
[{key: entry[key] for key in ("store", "seed", "samples_per_pixel")} for entry in json.loads(manifest.read_text())]

# %% [markdown]
# Renders with different seeds are independent, so the standard deviation over seeds estimates the true error of one render:

# %%
images = np.stack([ps.open_store(folder / "set" / entry["store"])["polarimetric"]["mean"].values for entry in json.loads(manifest.read_text())])
assert len({image.tobytes() for image in images}) == len(jobs)
images.std(axis=0, ddof=1).shape

# %%
client.close()
cluster.close()

# %% [markdown]
# Without Python, `sunstone render --part 3/64` and `sunstone merge` render and combine the same parts. The page [many
# machines](../clusters.md) shows a SLURM array job.
