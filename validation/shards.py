"""Compare stores in shards with the same stores in chunks, in folders and at s3:// addresses, on a local server (moto).

Renders a scene, copies it into shards at an address, and queries both through a proxy that counts requests and bytes, and that
fails a fifth of the requests on demand. Answers of the program and of xarray must be byte-identical. A copy that is killed and
repeated must equal a copy in a folder. Damage must be detected, with its location. Prints the requests of each query.

    python validation/shards.py            # checks
    python validation/shards.py --power    # applies damage: all must be detected

Requires what object_store.py requires, and s3fs for xarray.
"""

import argparse
import json
import os
import pathlib
import shutil
import subprocess
import sys
import tempfile
import time

import object_store
from object_store import BUCKET, SHARE, Server, ask, beside, check, files, killed, rendering, sunstone

QUESTIONS = [
    ("opening it", None),
    ("one pixel's profile (flight)", ["probe", "{}", "flight", "-k", "y=100", "-k", "x=60", "--csv", "-"]),
    ("one pixel's profile (xt)", ["probe", "{}", "xt", "-k", "x=33", "--csv", "-"]),
    ("one row of s-s'", ["probe", "{}", "ss", "-k", "x=20", "--csv", "-"]),
    ("a sum over everything", ["probe", "{}", "flight", "--sum", "y,x", "--csv", "-"]),
    ("what there is", ["info", "{}"]),
]


def size(folder):
    return sum(map(len, files(folder).values()))


def shape(store, array):
    """Return the lengths of a shard and of a chunk in it."""
    text = json.loads((store / array / "zarr.json").read_text())
    return text["chunk_grid"]["configuration"]["chunk_shape"], text["codecs"][0]["configuration"]["chunk_shape"]


def makes(server, work):
    """Make a copy in a folder and one at an address; print their sizes and times."""
    plain, sharded = work / "plain.zarr", work / "sharded.zarr"
    done = sunstone(server, *rendering("-o", plain, slices="xt,ss,flight", spp=8))
    assert done.returncode == 0, done.stderr.decode()
    times = []
    for _ in range(5):
        begun = time.monotonic()
        done = sunstone(server, "shard", plain, "-o", sharded, "--force")
        times.append(time.monotonic() - begun)
    check("a store is copied into shards", done.returncode == 0, done.stderr.decode())
    before, after = size(plain), size(sharded)
    rate = sorted(before / t / 1e6 for t in times)
    print(
        f"{len(files(plain))} files of {before / 1e6:.2f} MB, {len(files(sharded))} of {after / 1e6:.2f} MB "
        f"({100 * (after / before - 1):+.2f} %), {rate[2]:.1f} MB/s ({rate[0]:.1f} to {rate[-1]:.1f} of five)"
    )
    for array in ("flight/mean", "xt/mean", "ss/mean"):
        print(f"  {array}: shards and chunks of {shape(sharded, array)}")
    done = sunstone(server, "verify", sharded)
    check("verify accepts it", done.returncode == 0, (done.stdout + done.stderr).decode().strip())
    for store in (plain, sharded):
        server.upload(store, f"stores/{store.name}")
    same = lambda where: files(sharded) == where
    for share in (0.0, SHARE):
        server.proxy.reset(share, seed=2)
        name = f"copy{int(100 * share)}.zarr"
        begun = time.monotonic()
        done = sunstone(server, "shard", f"s3://{BUCKET}/stores/plain.zarr", "-o", f"s3://{BUCKET}/{name}")
        proxy = server.proxy
        reported = f"{len(proxy.requests)} requests {dict(proxy.kinds())}, {proxy.sent / 1e3:.0f} kB there, {proxy.bytes / 1e3:.0f} kB back"
        reported += f", {proxy.failed} failed, {time.monotonic() - begun:.1f} s"
        check(f"from address to address, {share:.0%} of requests failed", done.returncode == 0, reported + done.stderr.decode())
        check("the same bytes as in a folder", same(server.files(name)))
    server.proxy.reset()


def reads(server, work):
    """Check that answers are equal, and print their requests."""
    for share in (0.0, SHARE):
        for name, question in QUESTIONS:
            answers = []
            for store in ("plain", "sharded"):
                address = f"s3://{BUCKET}/stores/{store}.zarr"
                server.proxy.reset(share, seed=1)
                # The refusal of a missing slice comes after the store is open.
                answer = ask(server, question or ["probe", "{}", "none"], address)
                proxy = server.proxy
                answers.append(answer)
                failed = f", {proxy.failed} failed" if share else ""
                print(
                    f"     {name}, {store}: {len(proxy.requests)} requests ({proxy.ranges} of ranges), {proxy.bytes / 1e3:.1f} kB{failed}"
                    f" {dict(proxy.kinds())}"
                )
            here = ask(server, question, work / "sharded.zarr") if question else answers[0]
            held = answers[0][:2] == answers[1][:2] == here[:2] and answers[0][0] == (0 if question else 2)
            if name == "what there is":
                # For the store in shards, the output also states that it is in shards.
                lines = [set(a[1].decode().splitlines()) for a in answers]
                held = answers[0][0] == answers[1][0] == 0 and len(lines[0] ^ lines[1]) == 1
            check(f"{name}{', with failures' if share else ''}: the same", held, answers[1][2].strip()[:200])
    server.proxy.reset()


def trees(server, work):
    """Check that xarray and pysunstone read the store, and print the requests for a profile."""
    program = """
import sys, numpy as np, xarray as xr
from pysunstone.stores import open_store
plain, sharded, there = sys.argv[1:]
a, b, c = open_store(plain), xr.open_datatree(sharded, engine="zarr"), open_store(there, slices=["flight"])
for node in a.subtree:
    for name in node.data_vars:
        x, y = node[name].values, b[node.path][name].values
        assert (x.view("u4") == y.view("u4")).all(), (node.path, name)
print("opened", flush=True)
sys.stdin.readline()
profile = c["flight/mean"].isel(y=50, x=30).values
assert (profile == a["flight/mean"].isel(y=50, x=30).values).all()
"""
    for store in ("plain", "sharded"):
        server.proxy.reset()
        environment = {
            **os.environ,
            **server.environment,
            "AWS_ENDPOINT_URL": server.environment["AWS_ENDPOINT"],
        }
        words = [work / "plain.zarr", work / "sharded.zarr", f"s3://{BUCKET}/stores/{store}.zarr"]
        process = subprocess.Popen(
            [sys.executable, "-c", program, *map(str, words)],
            env=environment,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
        )
        process.stdout.readline()
        opened = len(server.proxy.requests)
        server.proxy.reset()
        _, errors = process.communicate(b"\n", timeout=300)
        proxy = server.proxy
        reported = f"{opened} requests to open a slice, a profile {len(proxy.requests)} ({proxy.ranges} of ranges), {proxy.bytes / 1e3:.1f} kB"
        check(f"xarray reads it, {store}", process.returncode == 0, reported + errors.decode()[-300:])


def kills(server, work):
    """Kill a copy command repeatedly, and run it again."""
    expected, prefix = files(work / "sharded.zarr"), "killed/a.zarr"
    address, kills = f"s3://{BUCKET}/{prefix}", 0
    server.proxy.reset()
    for shards in (0, 1, 5):
        process = beside(server, "shard", work / "plain.zarr", "-o", address)
        count = lambda: sum(1 for key in server.keys(prefix) if "/c." in key and key in expected and "_error" in key)
        while process.poll() is None and count() < shards:
            time.sleep(0.01)
        kills += killed(server, process, address, f"{shards} shards")
    check("copies were killed", kills == 3, str(kills))
    server.proxy.reset(SHARE, seed=7)
    done = sunstone(server, "shard", work / "plain.zarr", "-o", address)
    check("the copy is repeated, with failures", done.returncode == 0, done.stderr.decode())
    server.proxy.reset()
    check("the same bytes as in a folder", server.files(prefix) == expected)
    done = sunstone(server, "verify", address)
    check("verify accepts it", done.returncode == 0, done.stderr.decode())
    again = sunstone(server, "shard", work / "plain.zarr", "-o", address)
    check("an existing store stays", again.returncode == 2 and b"--force" in again.stderr, again.stderr.decode().strip())
    twice = sunstone(server, "shard", address, "-o", work / "twice.zarr")
    check("shards are not sharded", twice.returncode == 2 and b"already" in twice.stderr, twice.stderr.decode().strip())


def power(server, work):
    """Check that reading and verify detect damage and report its location."""
    prefix, array = "stores/sharded.zarr", "flight/mean"
    address, question = f"s3://{BUCKET}/{prefix}", QUESTIONS[1][1]
    shard = next(key for key in server.keys(prefix) if key.startswith(f"{array}/c."))
    key = f"{prefix}/{shard}"
    sound = server.get(key)
    lengths = shape(work / "sharded.zarr", array)
    chunks = 1
    for s, c in zip(*lengths):
        chunks *= s // c
    tail = len(sound) - 20 * chunks - 4
    program = "import sys\nfrom pysunstone.stores import open_store\nopen_store(sys.argv[1])['flight/mean'].values"

    def changed(at):
        bytes_ = bytearray(sound)
        bytes_[at] ^= 1
        return bytes(bytes_)

    before = ask(server, question, address)
    assert before[0] == 0, before[2]
    sum_before = ask(server, QUESTIONS[4][1], address)
    here = work / "damaged.zarr"
    shutil.copytree(work / "sharded.zarr", here)

    def from_python():
        return subprocess.run([sys.executable, "-c", program, str(here)], capture_output=True, timeout=300)

    check("Python reads the intact store", from_python().returncode == 0)
    for what, content in (
        ("a byte of a chunk", changed(tail // 2)),
        ("a byte of the checksums", changed(tail + 2 * chunks)),
        ("a byte of the index", changed(tail + 4 * chunks + 8 * chunks)),
        ("a byte of the index's checksum", changed(len(sound) - 1)),
        ("a truncated shard", sound[:-1]),
        ("a stub of a shard", sound[:100]),
        ("another array's shard", server.get(f"{prefix}/{shard.replace('mean', 'std_error')}")),
        ("a lost shard", None),
    ):
        if content is None:
            server.delete(key)
            (here / shard).unlink()
        else:
            server.put(key, content)
            (here / shard).write_bytes(content)
        for place in (address, here):
            code, _, text = ask(server, QUESTIONS[4][1], place)
            check(f"reading detects {what}", code == 2 and array in text, text.strip()[:260])
            done = sunstone(server, "verify", place)
            named = done.returncode == 1 and f"{shard}: ".encode() in done.stderr
            check(f"verify detects {what}", named, done.stderr.decode().split("\n")[1].strip()[:200])
        done = from_python()
        text = done.stderr.decode()
        held = done.returncode != 0 and any(word in text for word in ("DamagedStoreError", "checksum"))
        check(f"Python detects {what}", held, text.strip().split("\n")[-1][:200])
    server.put(key, sound)
    check("after the repair, it reads as before", ask(server, question, address)[:2] == before[:2])
    check("and so does all of it", ask(server, QUESTIONS[4][1], address)[:2] == sum_before[:2])


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--power", action="store_true")
    a = parser.parse_args()
    work = pathlib.Path(tempfile.mkdtemp())
    server = Server()
    try:
        makes(server, work)
        if a.power:
            power(server, work)
        else:
            reads(server, work)
            trees(server, work)
            kills(server, work)
    finally:
        server.close()
        shutil.rmtree(work)
    print(f"{len(object_store.failures)} failures" if object_store.failures else "all checks passed")
    sys.exit(bool(object_store.failures))


if __name__ == "__main__":
    main()
