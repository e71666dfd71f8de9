"""Stores below s3:// against the same stores in folders, on a server of this machine (moto, which speaks as Amazon S3 does).

Renders a scene, uploads the store, and reads it through a proxy that counts requests and bytes, and that fails a fifth of them
where it is told to: half with 503, half by cutting the connection in the middle of the body. Everything that is read must be, byte
for byte, what the folder gives.

    python validation/object_store.py            # checks
    python validation/object_store.py --power    # plants damage: each must be found

Needs moto[server] (validation/requirements.txt), and the program built with `cargo build --release`.
"""

import argparse
import collections
import contextlib
import http.client
import http.server
import os
import pathlib
import random
import shutil
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
# Share of requests that the proxy fails where it does.
SHARE = 0.2

failures = []


def check(what, holds, detail=""):
    print(f"{'ok  ' if holds else 'FAIL'} {what}{': ' + detail if detail else ''}", flush=True)
    if not holds:
        failures.append(what)


def free_port():
    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        return s.getsockname()[1]


class Proxy(http.server.ThreadingHTTPServer):
    """Passes requests on, counts them, and fails a share of them."""

    daemon_threads = True

    def __init__(self, behind):
        super().__init__(("127.0.0.1", 0), Handler)
        self.behind, self.lock = behind, threading.Lock()
        self.reset()

    def reset(self, share=0.0, seed=0):
        with self.lock:
            self.share, self.random = share, random.Random(seed)
            self.requests, self.bytes, self.failed = [], 0, 0

    def kinds(self):
        """Requests by what they are for."""
        count = collections.Counter()
        for method, path in self.requests:
            name = path.partition("?")[0].rpartition("/")[2]
            if method != "GET" or "list-type" in path:
                count[method if method != "GET" else "list"] += 1
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
            fails = server.random.random() < server.share
            cut = server.random.random() < 0.5
            server.failed += fails
        if fails and not cut:
            self.send_response(503)
            self.send_header("content-length", "0")
            self.end_headers()
            return
        connection = http.client.HTTPConnection("127.0.0.1", server.behind, timeout=60)
        connection.request(self.command, self.path, body, dict(self.headers))
        answer = connection.getresponse()
        content = answer.read()
        connection.close()
        with server.lock:
            server.bytes += len(content)
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


def render(server, out, *more):
    return sunstone(server, "render", SCENE, "--spp", "2", "--slices", "polarimetric,ss,xt", "--no-figures", "-o", out, *more)


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
    """What is read, how many requests that takes, and what failures do to it."""
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
            told = f"{len(proxy.requests)} requests {dict(proxy.kinds())}, {proxy.bytes / 1e3:.1f} kB, {seconds:.2f} s"
            if share:
                told += f", {proxy.failed} of them failed"
            check(f"{name}{', with failures' if share else ''}", here[0] == 0 and here[:2] == there[:2], told + there[2])
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
    # The names of the inputs stand in the root's description, and its checksum in the manifest.
    named = ("zarr.json", "manifest.txt")
    outs = [work / "merged_here.zarr", work / "merged_there.zarr"]
    for place, out in zip((str(work), f"s3://{BUCKET}/stores"), outs):
        done = sunstone(server, "merge", f"{place}/a.zarr", f"{place}/b.zarr", "-o", out)
        check(f"merge of {place}", done.returncode == 0, done.stderr.decode().strip())
    here, there = [{k: v for k, v in files(out).items() if k not in named} for out in outs]
    check("merge: the same bytes", here == there and len(here) > 100, f"{len(here)} files")


def refusals(server):
    """What cannot be read is told in one line, with the mend."""
    for address, changed, words in (
        (f"s3://{BUCKET}/stores/nothing.zarr", {}, ["does not exist"]),
        ("s3://no-such-bucket/a.zarr", {}, ["no such bucket", "AWS_ENDPOINT"]),
        (f"s3://{BUCKET}/stores/a.zarr", {"AWS_ALLOW_HTTP": "false"}, ["AWS_ALLOW_HTTP"]),
        (f"http://127.0.0.1:{free_port()}/a.zarr", {}, ["cannot be reached"]),
        ("s4://bucket/a.zarr", {}, ["s3://"]),
    ):
        old = dict(server.environment)
        server.environment.update(changed)
        done = sunstone(server, "info", address)
        server.environment = old
        text = done.stderr.decode()
        held = done.returncode == 2 and all(w in text for w in words) and text.count("\n") == 1 and address in text
        check(f"refusal of {address}", held, text.strip())


def power(server, work):
    """Damage must be found, by reading and by verify."""
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
        check(f"{what} is found by reading", code == 2 and "error" in text, text.strip()[:200])
        check(f"{what} is found by verify", done.returncode in (1, 2), done.stderr.decode().strip()[:200])

    server.put(chunk, bytes(spoilt))
    found("a spoilt chunk")
    server.delete(chunk)
    found("a lost chunk")
    server.put(chunk, sound)
    server.put(f"{prefix}/manifest.txt", (work / "b.zarr/manifest.txt").read_bytes())
    found("a manifest of another render")
    server.delete(f"{prefix}/manifest.txt")
    found("a lost manifest")
    server.put(f"{prefix}/manifest.txt", manifest)
    check("mended, it reads as before", ask(server, question, address)[:2] == before[:2])
    server.proxy.reset(1.0)
    code, _, text = ask(server, question, address)
    check("a server that always fails is an error", code == 2 and text.count("\n") == 1, text.strip()[:200])
    server.proxy.reset()


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--power", action="store_true")
    a = parser.parse_args()
    work = pathlib.Path(tempfile.mkdtemp())
    server = Server()
    try:
        for name, seed in (("a", "1"), ("b", "2")):
            done = render(server, work / f"{name}.zarr", "--seed", seed)
            assert done.returncode == 0, done.stderr.decode()
            server.upload(work / f"{name}.zarr", f"stores/{name}.zarr")
        if a.power:
            power(server, work)
        else:
            reads(server, work)
            refusals(server)
    finally:
        server.close()
        shutil.rmtree(work)
    print(f"{len(failures)} failures" if failures else "all as it should be")
    sys.exit(bool(failures))


if __name__ == "__main__":
    main()
