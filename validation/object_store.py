"""Compare stores at s3:// addresses with the same stores in folders, on a local server (moto, which implements the API of Amazon
S3).

Renders a scene, uploads the store, and reads it through a proxy that counts requests and bytes. On request the proxy fails a
fifth of them: half with 503, half by closing the connection in the middle of the body, or, for requests that change something,
after the change. All reads must return the same bytes as the folder. Then renders and merges to addresses, with kills, resumes
and duplicate runs: the written stores must be byte-identical to those in a folder.

    python validation/object_store.py            # checks
    python validation/object_store.py --power    # applies damage: all must be detected

Requires moto[server] (validation/requirements.txt), and the program built with `cargo build --release --features object-stores`.
"""

import argparse
import collections
import contextlib
import http.client
import http.server
import json
import os
import pathlib
import random
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from concurrent.futures import ThreadPoolExecutor

ROOT = pathlib.Path(__file__).resolve().parent.parent
PROGRAM = ROOT / "target/release/sunstone"
SCENE = ROOT / "scenes/mirror_room/scene.toml"
BUCKET = "renders"
# Fraction of requests that the proxy fails in tests with failures.
SHARE = 0.2
# Time after which a lock that is not renewed expires.
LEASE_S = 1.5

failures = []


begun = time.monotonic()


def check(what, holds, detail=""):
    print(f"{'ok  ' if holds else 'FAIL'} {time.monotonic() - begun:5.1f} {what}{': ' + detail if detail else ''}", flush=True)
    if not holds:
        failures.append(what)


def free_port():
    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        return s.getsockname()[1]


class Proxy(http.server.ThreadingHTTPServer):
    """Forwards requests, counts them, and fails a fraction of them."""

    daemon_threads = True

    def __init__(self, behind):
        super().__init__(("127.0.0.1", 0), Handler)
        self.behind, self.lock = behind, threading.Lock()
        # Whether the proxy removes the conditions of PUT requests.
        self.deaf = False
        self.reset()

    def handle_error(self, request, client_address):
        """Ignore errors of connections that killed clients close."""

    def reset(self, share=0.0, seed=0):
        with self.lock:
            self.share, self.random = share, random.Random(seed)
            self.requests, self.bytes, self.sent, self.failed, self.ranges = [], 0, 0, 0, 0

    def kinds(self):
        """Return the numbers of requests by purpose."""
        count = collections.Counter()
        for method, path in self.requests:
            name = path.partition("?")[0].rpartition("/")[2]
            if name == ".sunstone-lock":
                count["lock"] += 1
            elif method != "GET" or "list-type" in path:
                count[method if method != "GET" else "list"] += 1
            elif ".sunstone-progress/" in path:
                count["journal"] += 1
            elif name in ("manifest.txt", "zarr.json"):
                count["opening"] += 1
            elif name == "c.0":
                count["coordinates"] += 1
            else:
                count["chunks"] += 1
        return count


class Handler(http.server.BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"

    def log_message(self, *_):
        pass

    def any(self):
        server = self.server
        body = self.rfile.read(int(self.headers.get("content-length") or 0))
        with server.lock:
            server.requests.append((self.command, self.path))
            server.sent += len(body)
            server.ranges += "Range" in self.headers
            fails = server.random.random() < server.share
            cut = server.random.random() < 0.5
            server.failed += fails
        if fails and not cut:
            self.send_response(503)
            self.send_header("content-length", "0")
            self.end_headers()
            return
        connection = http.client.HTTPConnection("127.0.0.1", server.behind, timeout=60)
        headers = {k: v for k, v in self.headers.items() if not (server.deaf and k.lower().startswith("if-"))}
        connection.request(self.command, self.path, body, headers)
        answer = connection.getresponse()
        content = answer.read()
        connection.close()
        with server.lock:
            server.bytes += len(content)
        if fails and self.command != "GET":
            self.close_connection = True
            self.connection.shutdown(socket.SHUT_RDWR)
            return
        self.send_response(answer.status)
        for name, value in answer.getheaders():
            if name.lower() not in ("content-length", "connection", "transfer-encoding", "server", "date"):
                self.send_header(name, value)
        length = answer.getheader("content-length") if self.command == "HEAD" else len(content)
        self.send_header("content-length", str(length or 0))
        self.end_headers()
        if fails:
            self.wfile.write(content[: len(content) // 2])
            self.wfile.flush()
            self.close_connection = True
            self.connection.shutdown(socket.SHUT_RDWR)
            return
        self.wfile.write(content)

    do_GET = do_PUT = do_HEAD = do_POST = do_DELETE = any


class Server:
    def __init__(self):
        port = free_port()
        self.process = subprocess.Popen(
            [sys.executable, "-m", "moto.server", "-p", str(port)], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )
        for _ in range(300):
            with contextlib.suppress(OSError), socket.create_connection(("127.0.0.1", port), 1):
                break
            time.sleep(0.1)
        self.proxy = Proxy(port)
        threading.Thread(target=self.proxy.serve_forever, daemon=True).start()
        self.environment = {
            "AWS_ACCESS_KEY_ID": "testing",
            "AWS_SECRET_ACCESS_KEY": "testing",
            "AWS_REGION": "us-east-1",
            "AWS_ALLOW_HTTP": "true",
            "AWS_ENDPOINT": f"http://127.0.0.1:{self.proxy.server_address[1]}",
            "SUNSTONE_LEASE_S": str(LEASE_S),
        }
        os.environ.update(AWS_ACCESS_KEY_ID="testing", AWS_SECRET_ACCESS_KEY="testing", AWS_DEFAULT_REGION="us-east-1")
        import boto3
        from botocore.config import Config

        self.s3 = boto3.client(
            "s3", endpoint_url=f"http://127.0.0.1:{port}", config=Config(max_pool_connections=16)
        )
        self.s3.create_bucket(Bucket=BUCKET)

    def upload(self, folder, prefix):
        files = [p for p in pathlib.Path(folder).rglob("*") if p.is_file()]
        put = lambda p: self.put(f"{prefix}/{p.relative_to(folder).as_posix()}", p.read_bytes())
        with ThreadPoolExecutor(8) as pool:
            list(pool.map(put, files))

    def put(self, key, content):
        self.s3.put_object(Bucket=BUCKET, Key=key, Body=content)

    def get(self, key):
        return self.s3.get_object(Bucket=BUCKET, Key=key)["Body"].read()

    def delete(self, key):
        self.s3.delete_object(Bucket=BUCKET, Key=key)

    def keys(self, prefix):
        pages = self.s3.get_paginator("list_objects_v2").paginate(Bucket=BUCKET, Prefix=prefix + "/")
        return sorted(o["Key"][len(prefix) + 1 :] for page in pages for o in page.get("Contents", []))

    def files(self, prefix):
        keys = self.keys(prefix)
        with ThreadPoolExecutor(8) as pool:
            return dict(zip(keys, pool.map(lambda k: self.get(f"{prefix}/{k}"), keys)))

    def close(self):
        self.proxy.shutdown()
        self.process.terminate()
        self.process.wait()


def files(folder):
    return {p.relative_to(folder).as_posix(): p.read_bytes() for p in pathlib.Path(folder).rglob("*") if p.is_file()}


def sunstone(server, *arguments, timeout=300):
    return subprocess.run(
        [PROGRAM, *map(str, arguments)],
        env={**os.environ, **server.environment},
        stdin=subprocess.DEVNULL,
        capture_output=True,
        timeout=timeout,
    )


def rendering(*more, spp=2, slices="polarimetric,ss,xt", seed=1):
    return ["render", SCENE, "--spp", spp, "--slices", slices, "--seed", seed, "--no-figures", *more]


QUESTIONS = [
    ("one pixel's profile", ["probe", "{}", "xt", "-k", "x=33", "--csv", "-"]),
    ("one row of s-s'", ["probe", "{}", "ss", "-k", "x=20", "--csv", "-"]),
    ("a sum over everything", ["probe", "{}", "polarimetric", "--sum", "y,x", "--csv", "-"]),
    ("what there is", ["info", "{}"]),
]


def ask(server, question, store):
    done = sunstone(server, *[a.format(store) for a in question])
    text = done.stdout.replace(str(store).encode(), b"STORE")
    return done.returncode, text, done.stderr.decode()


def reads(server, work):
    """Check what is read, how many requests this takes, and the effect of failures."""
    folder, address = work / "a.zarr", f"s3://{BUCKET}/stores/a.zarr"
    files_there = files(folder)
    total = sum(map(len, files_there.values()))
    print(f"a store of {len(files_there)} files, {total / 1e6:.1f} MB")
    for share in (0.0, SHARE):
        for name, question in QUESTIONS:
            here = ask(server, question, folder)
            server.proxy.reset(share, seed=1)
            begun = time.monotonic()
            there = ask(server, question, address)
            seconds = time.monotonic() - begun
            proxy = server.proxy
            reported = f"{len(proxy.requests)} requests {dict(proxy.kinds())}, {proxy.bytes / 1e3:.1f} kB, {seconds:.2f} s"
            if share:
                reported += f", {proxy.failed} of them failed"
            check(f"{name}{', with failures' if share else ''}", here[0] == 0 and here[:2] == there[:2], reported + there[2])
            if not share:
                check(f"{name}: two requests open the store", proxy.kinds()["opening"] == 2)
    server.proxy.reset(SHARE, seed=2)
    done = sunstone(server, "verify", address)
    check("verify, with failures", done.returncode == 0, done.stdout.decode().strip() + done.stderr.decode())
    check("failures were met", server.proxy.failed > 0.1 * len(server.proxy.requests), f"{server.proxy.failed} of {len(server.proxy.requests)}")
    server.proxy.reset()
    for command, end, name in (
        (["decompose", "{}", "polarimetric", "-k", "wavelength=550", "-o"], "npz", "decompositions"),
        (["probe", "{}", "polarimetric", "-o"], "npy", "an array"),
        (["figure", "{}", "--view", "mueller", "--slice", "polarimetric", "-o"], "png", "a figure"),
    ):
        outs = [work / f"{where}.{end}" for where in ("here", "there")]
        for store, out in zip((folder, address), outs):
            done = sunstone(server, *[a.format(store) for a in command], out)
            check(f"{name} of {store}", done.returncode == 0, done.stderr.decode().strip())
        check(f"{name}: the same bytes", outs[0].read_bytes() == outs[1].read_bytes())


def refusals(server):
    """Check that stores that cannot be read give a message of one line, with the fix."""
    for address, changed, words in (
        (f"s3://{BUCKET}/stores/nothing.zarr", {}, ["does not exist"]),
        ("s3://no-such-bucket/a.zarr", {}, ["the bucket does not exist", "AWS_ENDPOINT"]),
        (f"s3://{BUCKET}/stores/a.zarr", {"AWS_ALLOW_HTTP": "false"}, ["AWS_ALLOW_HTTP"]),
        (f"http://127.0.0.1:{free_port()}/a.zarr", {}, ["cannot connect"]),
        ("s4://bucket/a.zarr", {}, ["s3://"]),
    ):
        old = dict(server.environment)
        server.environment.update(changed)
        done = sunstone(server, "info", address)
        server.environment = old
        text = done.stderr.decode()
        held = done.returncode == 2 and all(w in text for w in words) and text.count("\n") == 1 and address in text
        check(f"refusal of {address}", held, text.strip())


def same_render(what, here, there):
    """Check for the same bytes, except for the render time in the root's metadata and its line of the manifest."""
    names = [n for n in here if n.endswith(".txt")]
    timed = ("zarr.json", *names)
    differ = [name for name in here if name not in timed and here[name] != there.get(name)]
    root = [json.loads(files["zarr.json"]) for files in (here, there) if "zarr.json" in files]
    for description in root:
        description["attributes"].pop("wall_time_s")
        # Inputs are named by their addresses.
        description["attributes"].pop("merged_from", None)
    lines = [
        sorted(line for n in names for line in files[n].decode().splitlines()[1:-1] if not line.endswith(" zarr.json"))
        for files in (here, there)
        if all(n in files for n in names)
    ]
    held = sorted(here) == sorted(there) and not differ and root[:1] == root[1:] and lines[:1] == lines[1:]
    check(f"{what}: the same bytes", held, f"{len(there)} files {' '.join(differ[:3])}")


def reported(server, seconds, done=None):
    proxy = server.proxy
    text = f"{len(proxy.requests)} requests {dict(proxy.kinds())}, {proxy.sent / 1e3:.0f} kB there, {proxy.bytes / 1e3:.0f} kB back, {seconds:.1f} s"
    if proxy.share:
        text += f", {proxy.failed} failed"
    return text + (done.stderr.decode()[:300] if done and done.returncode else "")


def timed(server, share, work, seed=3):
    server.proxy.reset(share, seed)
    begun = time.monotonic()
    done = work()
    return done, reported(server, time.monotonic() - begun, done)


def killed(server, process, address, at):
    """Kill a process that writes a store, which is then unfinished; return whether the process was running."""
    ran = process.poll() is None
    if ran:
        process.send_signal(signal.SIGKILL)
    process.wait()
    done = sunstone(server, "verify", address)
    check(f"killed at {at}: the store is not finished", done.returncode == 2, done.stderr.decode().strip())
    return ran


def beside(server, *arguments):
    """Start the program in parallel."""
    return subprocess.Popen(
        [PROGRAM, *map(str, arguments)],
        env={**os.environ, **server.environment},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
    )


def wait_for_tiles(server, prefix, process, tiles):
    """Wait until the given number of tiles is recorded in the store."""
    while process.poll() is None and len(server.keys(f"{prefix}/.sunstone-progress")) < tiles:
        time.sleep(0.02)


def writes(server, work):
    """Render and merge to an address."""
    expected, root = files(work / "a.zarr"), f"s3://{BUCKET}"
    for share in (0.0, SHARE):
        name = f"written{int(100 * share)}"
        address = f"{root}/{name}/a.zarr"
        done, text = timed(server, share, lambda: sunstone(server, *rendering("-o", address)))
        check(f"a render, {share:.0%} of requests failed", done.returncode == 0, text)
        same_render(f"a render, {share:.0%} of requests failed", expected, server.files(f"{name}/a.zarr"))
    server.proxy.reset()
    done = sunstone(server, "verify", address)
    check("verify accepts it", done.returncode == 0, done.stderr.decode())
    again = sunstone(server, *rendering("-o", address))
    check("an existing store stays", again.returncode == 2 and b"--force" in again.stderr, again.stderr.decode().strip())
    done, text = timed(server, 0.0, lambda: sunstone(server, *rendering("-o", address, "--resume")))
    check("a complete store is not rendered again", b"already complete" in done.stdout, text)
    done, text = timed(server, SHARE, lambda: sunstone(server, *rendering("-o", address, "--force", slices="xt")))
    kept = {name.partition("/")[0] for name in server.keys("written20/a.zarr")}
    check("--force replaces it", done.returncode == 0 and kept == {"zarr.json", "manifest.txt", "samples", "xt"}, text)
    server.put("mine/a.zarr/thesis.tex", b"text")
    other = sunstone(server, *rendering("-o", f"{root}/mine/a.zarr", "--force"))
    held = other.returncode == 2 and b"not a Sunstone store" in other.stderr
    check("--force replaces only stores", held and server.keys("mine/a.zarr") == ["thesis.tex"], other.stderr.decode().strip())
    done = sunstone(server, *rendering("-o", f"http://127.0.0.1:{server.proxy.behind}/{BUCKET}/web/a.zarr"))
    check("a web server is read only", done.returncode == 2 and b"read-only" in done.stderr, done.stderr.decode().strip())
    merges(server, work, root)
    kills(server, expected, root)


def merges(server, work, root):
    """Merge parts from machines without a shared folder, and merge seeds."""
    parts = [f"{root}/parts/{k}.zarr" for k in (1, 2)]
    for k, part in enumerate(parts, 1):
        done, text = timed(server, SHARE, lambda: sunstone(server, *rendering("--part", f"{k}/2", "-o", part)), seed=4)
        check(f"part {k} of 2, with failures", done.returncode == 0, text)
    server.proxy.reset()
    done = sunstone(server, "probe", parts[0], "xt", "-k", "x=33", "--csv", "-")
    check("a part is not read as a store", done.returncode == 2 and b"part 1 of 2" in done.stderr, done.stderr.decode().strip())
    done = sunstone(server, "verify", parts[0])
    check("verify accepts a part", done.returncode == 0, (done.stdout + done.stderr).decode().strip())
    done, text = timed(server, SHARE, lambda: sunstone(server, "merge", *parts, "-o", f"{root}/joined/a.zarr"), seed=5)
    check("parts are joined, with failures", done.returncode == 0, text)
    same_render("parts joined", files(work / "a.zarr"), server.files("joined/a.zarr"))
    here = [work / f"{n}.zarr" for n in "ab"]
    done = sunstone(server, "merge", *here, "-o", work / "pooled.zarr")
    check("seeds are pooled in a folder", done.returncode == 0, done.stderr.decode().strip())
    stores = [f"{root}/stores/{n}.zarr" for n in "ab"]
    done, text = timed(server, SHARE, lambda: sunstone(server, "merge", *stores, "-o", f"{root}/pooled/a.zarr"), seed=6)
    check("seeds are pooled, with failures", done.returncode == 0, text)
    same_render("seeds pooled", files(work / "pooled.zarr"), server.files("pooled/a.zarr"))
    server.proxy.reset()
    done = sunstone(server, "merge", *stores, "-o", f"{root}/pooled/a.zarr")
    check("a merge keeps an existing store", done.returncode == 2 and b"--force" in done.stderr, done.stderr.decode().strip())


def kills(server, expected, root):
    """Check renders that are killed, run twice, and paused for longer than their lease."""
    prefix = "killed/a.zarr"
    address = f"{root}/{prefix}"
    kills = 0
    server.proxy.reset()
    for tiles in (0, 3, 24):
        process = beside(server, *rendering("-o", address, *(["--resume"] if kills else [])))
        if tiles:
            wait_for_tiles(server, prefix, process, tiles)
        else:
            while not server.keys(prefix):
                time.sleep(0.02)
        kills += killed(server, process, address, f"{tiles} tiles")
    check("renders were killed", kills == 3, str(kills))

    holder = beside(server, *rendering("-o", address, "--resume"))
    wait_for_tiles(server, prefix, holder, 30)
    holder.send_signal(signal.SIGSTOP)
    done, text = timed(server, SHARE, lambda: sunstone(server, *rendering("-o", address, "--resume")), seed=7)
    check("a lock without renewal is lost; the render resumes after three kills, with failures", done.returncode == 0, text)
    server.proxy.reset()
    holder.send_signal(signal.SIGCONT)
    _, errors = holder.communicate(timeout=300)
    check("a process without the lock stops", holder.returncode != 0 and b"lock" in errors, errors.decode().strip()[-300:])
    same_render("killed three times and run twice", expected, server.files(prefix))

    first = beside(server, *rendering("-o", f"{root}/two/a.zarr", "--threads", "1", spp=16))
    wait_for_tiles(server, "two/a.zarr", first, 1)
    second = sunstone(server, *rendering("-o", f"{root}/two/a.zarr", "--force"))
    held = first.poll() is None and second.returncode == 2 and f"process {first.pid} " in second.stderr.decode()
    check("of two writers, the second is refused", held, second.stderr.decode().strip())
    first.kill()
    first.wait()


def power(server, work):
    """Check that reading and verify detect damage."""
    address, prefix = f"s3://{BUCKET}/stores/a.zarr", "stores/a.zarr"
    question = QUESTIONS[0][1]
    server.proxy.reset()
    before = ask(server, question, address)
    assert before[0] == 0, before[2]
    chunk = next(
        path.partition("/renders/")[2]
        for method, path in server.proxy.requests
        if "/xt/mean/c." in path
    )
    sound = server.get(chunk)
    spoilt = bytearray(sound)
    spoilt[len(spoilt) // 2] ^= 1
    manifest = server.get(f"{prefix}/manifest.txt")

    def found(what):
        code, _, text = ask(server, question, address)
        done = sunstone(server, "verify", address)
        check(f"reading detects {what}", code == 2 and "error" in text, text.strip()[:200])
        check(f"verify detects {what}", done.returncode in (1, 2), done.stderr.decode().strip()[:200])

    server.put(chunk, bytes(spoilt))
    found("a damaged chunk")
    server.delete(chunk)
    found("a lost chunk")
    server.put(chunk, sound)
    server.put(f"{prefix}/manifest.txt", (work / "b.zarr/manifest.txt").read_bytes())
    found("a manifest of another render")
    server.delete(f"{prefix}/manifest.txt")
    found("a lost manifest")
    server.put(f"{prefix}/manifest.txt", manifest)
    check("after the repair, it reads as before", ask(server, question, address)[:2] == before[:2])
    server.proxy.reset(1.0)
    code, _, text = ask(server, question, address)
    check("a server that always fails is an error", code == 2 and text.count("\n") == 1, text.strip()[:200])
    server.proxy.reset()

    server.proxy.deaf = True
    done = sunstone(server, *rendering("-o", f"s3://{BUCKET}/deaf/a.zarr"))
    held = done.returncode == 2 and b"If-None-Match" in done.stderr and not server.keys("deaf/a.zarr")
    check("a server that ignores conditions is detected", held, done.stderr.decode().strip())
    server.proxy.deaf = False
    prefix = "robbed/a.zarr"
    process = beside(server, *rendering("-o", f"s3://{BUCKET}/{prefix}", "--threads", "1", spp=64))
    wait_for_tiles(server, prefix, process, 1)
    server.delete(f"{prefix}/.sunstone-lock")
    _, errors = process.communicate(timeout=300)
    held = process.returncode != 0 and b"lock" in errors and "manifest.txt" not in server.keys(prefix)
    check("a lock that is removed is detected", held, errors.decode().strip()[-300:])
    # A resumed render reuses the checksums of existing chunks, so that later checks detect damage.
    process = beside(server, *rendering("-o", f"s3://{BUCKET}/spoilt/a.zarr"))
    wait_for_tiles(server, "spoilt/a.zarr", process, 20)
    process.kill()
    process.wait()
    chunk = next(k for k in server.keys("spoilt/a.zarr") if k.startswith("ss/mean/c."))
    content = bytearray(server.get(f"spoilt/a.zarr/{chunk}"))
    content[len(content) // 2] ^= 1
    server.put(f"spoilt/a.zarr/{chunk}", bytes(content))
    done = sunstone(server, *rendering("-o", f"s3://{BUCKET}/spoilt/a.zarr", "--resume"))
    found_there = sunstone(server, "verify", f"s3://{BUCKET}/spoilt/a.zarr")
    held = done.returncode != 0 or found_there.returncode != 0
    check("a chunk damaged before a resumed render is detected", held, (done.stderr + found_there.stderr).decode().strip()[:300])


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--power", action="store_true")
    a = parser.parse_args()
    work = pathlib.Path(tempfile.mkdtemp())
    server = Server()
    try:
        for name, seed in (("a", 1), ("b", 2)):
            done = sunstone(server, *rendering("-o", work / f"{name}.zarr", seed=seed))
            assert done.returncode == 0, done.stderr.decode()
            server.upload(work / f"{name}.zarr", f"stores/{name}.zarr")
        if a.power:
            power(server, work)
        else:
            reads(server, work)
            refusals(server)
            writes(server, work)
    finally:
        server.close()
        shutil.rmtree(work)
    print(f"{len(failures)} failures" if failures else "all checks passed")
    sys.exit(bool(failures))


if __name__ == "__main__":
    main()
