#!/usr/bin/env python3
"""Compare photon files (.ptu) with ptufile: each program reads what the other writes.

For each of the twelve record types:
- words: random records with a header from ptufile's own `encode_tag`, decoded by `sunstone ptu records` and by ptufile;
- written: random photons, syncs and markers over many clock overflows, written by `sunstone ptu write`, read by ptufile;
- histogram: of that file by `sunstone ptu histogram` and by ptufile's `decode_histogram` (T3), or by NumPy from ptufile's records
  (T2).
Then scans that ptufile's `imwrite` writes, in both record types that it supports, by pixel, channel and bin. Then sweeps: images
whose lines are scanned back and forth (`ImgHdr_BiDirect`), sinusoidally (`ImgHdr_SinCorrection`), or both, with several frames of
which the first may lack its beginning. Then tags of every type that `encode_tag` supports. All records and counts must be equal.
Exits with 1 if a row fails.

`--power` applies errors to the input files, one at a time (each bit of one record, a missing overflow, the type of a tag, a torn
record's bytes, a photon's bin), and checks that each is detected.
"""

import argparse
import csv
import io
import subprocess
import sys
import tempfile
from pathlib import Path

import environment

if __name__ == "__main__" and not {"-h", "--help"} & set(sys.argv):
    environment.enter()
    import logging

    import numpy as np
    import ptufile
    from ptufile.ptufile import encode_tag

    logging.getLogger("ptufile").setLevel(logging.CRITICAL)

TYPES = {
    "picoharp-300-t2": 0x00010203, "picoharp-300-t3": 0x00010303, "hydraharp-1-t2": 0x00010204, "hydraharp-1-t3": 0x00010304,
    "hydraharp-2-t2": 0x01010204, "hydraharp-2-t3": 0x01010304, "timeharp-260-n-t2": 0x00010205, "timeharp-260-n-t3": 0x00010305,
    "timeharp-260-p-t2": 0x00010206, "timeharp-260-p-t3": 0x00010306, "multiharp-t2": 0x00010207, "multiharp-t3": 0x00010307,
}
COUNT = 20_000
SPECIAL = 1 << 31


def run(*arguments):
    """Return the program's output; None if it refuses."""
    done = subprocess.run([environment.sunstone(), "ptu", *map(str, arguments)], capture_output=True, text=True)
    if done.returncode not in (0, 2):
        sys.exit(f"sunstone ptu {' '.join(map(str, arguments))}: {done.stderr}")
    return done.stdout if done.returncode == 0 else None


def ours(path):
    """Return records as Sunstone reads them: kind, time, dtime, channel, markers. Missing fields are -1, missing markers 0. None
    if refused.
    """
    text = run("records", path)
    if text is None:
        return None
    rows = []
    for kind, *numbers in list(csv.reader(io.StringIO(text)))[1:]:
        time, dtime, channel, markers = (int(n) if n else -1 for n in numbers)
        # ptufile gives meaningless times for overflows, and channel 0 for sync pulses.
        rows.append((-1 if kind in ("overflow", "unknown") else time, dtime, 0 if kind == "sync" else channel, max(markers, 0)))
    return np.array(rows, np.int64).reshape(-1, 4)


def theirs(path):
    """Return records as ptufile reads them, in the same format."""
    with ptufile.PtuFile(path) as file:
        records, t3 = file.decode_records(), file.is_t3
    over = (records["channel"] < 0) & (records["marker"] == 0)
    time = np.where(over, -1, records["time"].astype(np.int64))
    dtime = records["dtime"] if t3 else np.where(records["channel"] >= 0, 0, -1)
    return np.stack([time, dtime, records["channel"], records["marker"]], axis=1).astype(np.int64)


def different(a, b, t3):
    """Return the number of records that differ. Records of T2 have no dtime."""
    if a is None or len(a) != len(b):
        return max(len(b), 1)
    columns = [0, 1, 2, 3] if t3 else [0, 2, 3]
    return int((a[:, columns] != b[:, columns]).any(axis=1).sum())


def words(code, rng, count=COUNT):
    """Return random records of a type, of all meaningful kinds."""
    t3, pico = code >> 8 & 3 == 3, code & 0xFF == 3
    kind = rng.integers(0, 10, count)
    bits = rng.integers(1, 16, count)
    if pico:
        photon = rng.integers(0, 1 << 28, count) | rng.integers(1, 5, count) << 28
        if t3:
            marker = 15 << 28 | bits << 16 | rng.integers(0, 1 << 16, count)
            over = 15 << 28 | rng.integers(0, 1 << 16, count) * 0
        else:
            marker = 15 << 28 | rng.integers(0, 1 << 24, count) << 4 | bits
            over = np.full(count, 15 << 28)
            photon = np.where(kind == 2, photon & 0x0FFFFFFF, photon)
    else:
        photon = rng.integers(0, SPECIAL, count)
        low = rng.integers(0, 1 << (10 if t3 else 25), count)
        marker = SPECIAL | bits << 25 | low
        over = SPECIAL | 63 << 25 | rng.integers(0, 4, count)
        if not t3:
            photon = np.where(kind == 2, SPECIAL | low, photon)
    return np.where(kind == 0, marker, np.where(kind == 1, over, photon)).astype("<u4")


def whole(code, records, **more):
    """Return a file with ptufile's tags and these records."""
    tags = {"Measurement_Mode": 3 if code >> 8 & 3 == 3 else 2, "Measurement_SubMode": 0, "MeasDesc_GlobalResolution": 1e-7,
            "MeasDesc_Resolution": 25e-12, "TTResult_SyncRate": 10_000_000, "TTResult_NumberOfRecords": len(records),
            "TTResultFormat_TTTRRecType": code, "TTResultFormat_BitsPerRecord": 32, **more}
    out = b"PQTTTR\0\0" + b"1.0.00\0\0"
    for name, value in tags.items():
        out += b"".join(encode_tag(name, v, i) for i, v in enumerate(value)) if isinstance(value, list) else encode_tag(name, value)
    return out + encode_tag("Header_End", None) + np.asarray(records, "<u4").tobytes()


def events(code, rng, count=COUNT):
    """Return random events of a type, in the order of time, as rows of ours()."""
    t3, pico = code >> 8 & 3 == 3, code & 0xFF == 3
    kind = rng.integers(0, 20, count)
    gaps = np.where(rng.integers(0, 100, count) == 0, rng.integers(0, 400_000_000 if not t3 else 3_000_000, count), rng.integers(0, 50, count))
    time = np.cumsum(gaps) * 16
    dtime = rng.integers(0, 4096 if pico else 1 << 15, count) if t3 else np.zeros(count, int)
    first, last = (0, 4) if pico and t3 else (1, 5) if pico else (0, 64)
    channel = rng.integers(first, last, count)
    bits = rng.integers(1, 16, count)
    marker, sync = kind == 0, (kind == 1) & (not t3)
    if pico and not t3:
        # Markers of these records occupy the last bits of the time.
        time = time + np.where(marker, bits, 15 * (np.cumsum(marker) * 0 + 1))
        time[~marker] = time[~marker] // 16 * 16 + 15
    rows = np.stack([time, np.where(marker | sync, -1, dtime), np.where(marker, -1, np.where(sync, 0, channel)), np.where(marker, bits, 0)], axis=1)
    lines = ["kind,time,dtime,channel,markers"]
    for (t, d, c, m), s in zip(rows.tolist(), sync):
        lines.append(f"marker,{t},,,{m}" if m else f"sync,{t},,," if s else f"photon,{t},{d},{c},")
    order = np.argsort(time, kind="stable")
    return rows[order], "\n".join([lines[0]] + [lines[i + 1] for i in order])


def histogram(path, folder, *more):
    """Return Sunstone's histogram."""
    out = folder / "h.npy"
    out.unlink(missing_ok=True)
    return np.load(out) if run("histogram", path, "-o", out, *more) is not None else None


def unequal(a, b):
    """Return the number of counts that differ."""
    return max(b.size, 1) if a is None or a.shape != b.shape else int((a.astype(np.int64) != b.astype(np.int64)).sum())


def wanted(path, rows, bins, bin_width):
    """Return ptufile's histogram by channel; for T2 it is computed with NumPy from the times since the last sync pulse."""
    with ptufile.PtuFile(path, trimdims="") as file:
        if file.is_t3:
            counts = file.decode_histogram(dtime=32768 * 2).astype(np.int64)
            counts = counts[:, : bins * bin_width]
            return counts.reshape(len(counts), bins, bin_width).sum(axis=2)
        records = file.decode_records()
    raw = file_words(path)
    code = ptufile_code(path)
    sync = (raw >> 28 == 0) if code & 0xFF == 3 else (raw >> 25 == 64)
    photon = (records["channel"] >= 0) & ~sync
    last = np.maximum.accumulate(np.where(sync, records["time"].astype(np.int64), -1))
    since = records["time"].astype(np.int64) - last
    keep = photon & (last >= 0) & (since < bins * bin_width)
    out = np.zeros((64, bins), np.int64)
    np.add.at(out, (records["channel"][keep], since[keep] // bin_width), 1)
    return out


def file_words(path):
    with ptufile.PtuFile(path) as file:
        return file.read_records().copy()


def ptufile_code(path):
    with ptufile.PtuFile(path) as file:
        return int(file.tags["TTResultFormat_TTTRRecType"])


def compare(name, code, rng, folder):
    """Yield the rows of a type: what is compared, the number of records, and the number that differ."""
    t3, path = code >> 8 & 3 == 3, folder / "f.ptu"
    path.write_bytes(whole(code, words(code, rng)))
    yield "words", COUNT, different(ours(path), theirs(path), t3)
    rows, text = events(code, rng)
    (folder / "e.csv").write_text(text)
    path.unlink()
    period = 100_000 if t3 else 1
    if run("write", folder / "e.csv", "-o", path, "--record", name, "--period-ps", period) is None:
        yield "written", COUNT, COUNT
        return
    read = theirs(path)
    yield "written", COUNT, different(rows, read[read[:, 0] >= 0], t3)
    with ptufile.PtuFile(path) as file:
        tags = file.tags
    right = tags["TTResultFormat_TTTRRecType"] == code and tags["TTResult_NumberOfRecords"] == len(read)
    yield "its tags", 2, 0 if right and np.isclose(tags["MeasDesc_GlobalResolution"], period * 1e-12) else 1
    width, bins = (4, 1000) if t3 else (16, 500)
    counts = wanted(path, read, bins, width)
    used = np.flatnonzero(counts.sum(axis=1))
    found = histogram(path, folder, "--channel", ",".join(map(str, used)), "--bins", bins, "--bin-ps", width * (25 if t3 else 1))
    assert counts.sum() > COUNT / 100, "an empty histogram"
    yield "histogram", counts[used].size, unequal(found, counts[used])


def scans(rng, folder):
    """Yield scans that ptufile writes."""
    path = folder / "scan.ptu"
    for shape in ((3, 16, 24, 2, 500), (1, 32, 8, 5, 2000)):
        image = rng.poisson(0.05, shape).astype(np.uint32)
        ptufile.imwrite(path, image, 1e-7, 25e-12)
        with ptufile.PtuFile(path, trimdims="") as file:
            read = file.decode_image(frame=-1, dtime=shape[4])[0]
        read = read[:, :, : shape[3]]
        found = histogram(path, folder, "--pixels", f"{shape[2]},{shape[1]}", "--bins", shape[4])
        yield f"scan {'x'.join(map(str, shape))}", image[0].size, unequal(found, read) + unequal(found, image.sum(axis=0))


def encoded(events):
    """Return records of TimeHarp 260 P T3 for events (time, dtime) and markers (time, -bits), in the order of time."""
    records, over = [], 0
    for time, dtime in events:
        turns = time // 1024 - over
        if turns:
            records.append(SPECIAL | 63 << 25 | turns)
            over += turns
        records.append(SPECIAL | -dtime << 25 | time % 1024 if dtime < 0 else dtime << 10 | time % 1024)
    return records


def sweep(rng, width, height, pixel_time, back, percent, torn):
    """Return events of three frames of lines. Photons are at random places; `torn` lines of the first frame are missing from the
    file.
    """
    line = width * pixel_time
    ticks = np.arange(line)
    if percent:
        edges = 0.5 * line * (1 + np.arcsin(percent / 100 * (2 * np.arange(width + 1) / width - 1)) / np.arcsin(percent / 100))
        # A pixel that begins on a whole count begins there or, due to rounding, one count later.
        exact = np.abs(edges - edges.round()) < 1e-6
        ticks = np.setdiff1d(ticks, edges[exact].round().astype(int))
    events, time = [], 2000
    for frame in range(3):
        for _ in range(torn if frame == 0 else 0, height):
            events.append((time, -1))
            photons = np.sort(rng.choice(ticks, 40))
            events += [(time + int(t), int(d)) for t, d in zip(photons, rng.integers(0, 50, 40))]
            # Some photons come after the last pixel, and some between lines.
            events += [(time + line + int(t), 1) for t in np.sort(rng.integers(0, 50, 5))]
            events += [(time + line + 60, -2), (time + line + 70, 3)]
            time += line + 100
        events.append((time, -4))
        time += 500
    return encoded(events)


def sweeps(rng, folder):
    """Yield images by lines, compared with ptufile's: what is compared, the number of counts, and the number that differ."""
    path = folder / "sweep.ptu"
    width, height, pixel_time, bins = 12, 9, 101, 50
    for back in (False, True):
        for percent in (0, 80, 100.0, 12.5):
            for torn in (0, 1, 4):
                tags = {"Measurement_SubMode": 3, "ImgHdr_Dimensions": 3, "ImgHdr_Ident": 3, "ImgHdr_LineStart": 1, "ImgHdr_LineStop": 2,
                        "ImgHdr_Frame": 3, "ImgHdr_TimePerPixel": pixel_time * 1e-4, "ImgHdr_PixX": width, "ImgHdr_PixY": height,
                        "ImgHdr_BiDirect": back, "ImgHdr_SinCorrection": percent}
                path.write_bytes(whole(0x00010306, sweep(rng, width, height, pixel_time, back, percent, torn), **tags))
                with ptufile.PtuFile(path, trimdims="T") as file:
                    read = file.decode_image(frame=-1, channel=0, dtime=bins)
                found = histogram(path, folder, "--pixels", f"{width},{height}", "--bins", bins)
                read = read.reshape(height, width, 1, bins)
                assert read.sum() > 40 * height, "an empty image"
                name = f"sweep{' back' * back}{f', sine {percent} %' * bool(percent)}, {torn} lines torn"
                yield name, read.size, unequal(found, read)


def tags(folder):
    """Yield tags of all types, as `ptu info` prints them."""
    import datetime

    path = folder / "tags.ptu"
    values = {"A_Bool": True, "A_Int": -(1 << 62), "A_Float": 1.25e-300, "A_Text": "µm × 5 €", "A_Wide": "λ 中", "A_Blob": bytes(range(16)),
              "A_Time": datetime.datetime(2021, 6, 1, 12), "A_List": [1, 2, 3], "A_Empty": None}
    path.write_bytes(whole(0x00010305, [0], **values))
    text = (run("info", path) or "").splitlines()
    expected = ["A_Bool = true", f"A_Int = {-(1 << 62)}", "A_Float = 1.25e-300", 'A_Text = "µm × 5 €"', 'A_Wide = "λ 中"',
                "A_Blob = 16 bytes", "A_Time = 44348.5 days since 1899-12-30", "A_List[0] = 1", "A_List[1] = 2", "A_List[2] = 3",
                "A_Empty = (empty)"]
    return len(expected), sum(line not in text for line in expected)


def power(rng, folder):
    """Yield planted errors: the error, the number planted, and the number detected."""
    good, bad = folder / "good.ptu", folder / "bad.ptu"
    for name, code in TYPES.items():
        t3 = code >> 8 & 3 == 3
        records = words(code, rng, 200)
        # The record of a photon in the middle of the file.
        good.write_bytes(whole(code, records))
        truth = theirs(good)
        at = np.flatnonzero((truth[:, 2] >= 0) & (truth[:, 3] == 0))[50]
        noticed = 0
        for bit in range(32):
            planted = records.copy()
            planted[at] ^= np.uint32(1 << bit)
            bad.write_bytes(whole(code, planted))
            noticed += different(ours(bad), truth, t3) > 0
        yield f"{name}: a bit of a record", 32, noticed
        over = np.flatnonzero(truth[:, 0] < 0)[3]
        bad.write_bytes(whole(code, np.delete(records, over)))
        read = ours(bad)
        read = None if read is None else read[read[:, 0] >= 0]
        yield f"{name}: an overflow lost", 1, int(different(read, truth[truth[:, 0] >= 0], t3) > 0)
    # Errors in the tag of the record type: another type, another code as its value, bits that a record does not have.
    data = whole(0x00010305, words(0x00010305, rng, 200))
    good.write_bytes(data)
    truth = theirs(good)
    at = data.find(b"TTResultFormat_TTTRRecType")
    for what, where, value in (("type", 39, 0x20), ("type unknown", 39, 0x33), ("value", 40, 0x04), ("value of T2", 41, 0x02)):
        planted = bytearray(data)
        planted[at + where] = value
        # The first version of the HydraHarp only counts overflows: the next byte is that of the TimeHarp's last one.
        bad.write_bytes(planted)
        yield f"a tag's {what}", 1, int(different(ours(bad), truth, True) > 0)
    bad.write_bytes(data[:-2])
    yield "a torn record", 1, int(different(ours(bad), truth, True) > 0)
    path = folder / "scan.ptu"
    image = rng.poisson(0.5, (1, 8, 8, 1, 64)).astype(np.uint32)
    ptufile.imwrite(path, image, 1e-7, 25e-12)
    data = bytearray(path.read_bytes())
    data[-4 * 40 + 2] ^= 1
    path.write_bytes(data)
    found = histogram(path, folder, "--pixels", "8,8", "--bins", 64)
    yield "a bin of a scan", 1, int(unequal(found, image.sum(axis=0)) > 0)


    # Tags of a sweep, each with a value that differs from the file's.
    width, height, pixel_time = 12, 9, 101
    own = {"Measurement_SubMode": 3, "ImgHdr_Dimensions": 3, "ImgHdr_LineStart": 1, "ImgHdr_LineStop": 2, "ImgHdr_Frame": 3,
           "ImgHdr_TimePerPixel": pixel_time * 1e-4, "ImgHdr_PixX": width, "ImgHdr_PixY": height, "ImgHdr_BiDirect": True,
           "ImgHdr_SinCorrection": 80}
    records = sweep(rng, width, height, pixel_time, True, 80, 4)
    good.write_bytes(whole(0x00010306, records, **own))
    with ptufile.PtuFile(good, trimdims="T") as file:
        truth = file.decode_image(frame=-1, channel=0, dtime=50).reshape(height, width, 1, 50)
    for tag, value in {"ImgHdr_BiDirect": False, "ImgHdr_SinCorrection": 79, "ImgHdr_LineStart": 2, "ImgHdr_Frame": 4,
                       "ImgHdr_TimePerPixel": 102e-4, "ImgHdr_PixX": 11, "ImgHdr_PixY": 8}.items():
        bad.write_bytes(whole(0x00010306, records, **{**own, tag: value}))
        found = histogram(bad, folder, "--pixels", f"{width},{height}", "--bins", 50)
        yield f"a sweep's {tag}", 1, int(unequal(found, truth) > 0)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--power", action="store_true", help="check that planted errors are detected")
    parser.add_argument("--seed", type=int, default=1, help="seed of records, events and scans")
    a = parser.parse_args()
    failed = False
    rng = np.random.default_rng(a.seed)
    with tempfile.TemporaryDirectory() as folder:
        folder = Path(folder)
        if a.power:
            for what, planted, noticed in power(rng, folder):
                failed |= noticed < planted
                print(f"{what:44} {noticed:3} of {planted:3} {'detected' if noticed == planted else 'NOT ALL DETECTED'}", flush=True)
            sys.exit(1 if failed else 0)
        print(f"{'':44} {'compared':>9} {'different':>9}")
        for name, code in TYPES.items():
            for what, count, wrong in compare(name, code, rng, folder):
                failed |= wrong > 0
                print(f"{name + ', ' + what:44} {count:9} {wrong:9}", flush=True)
        for what, count, wrong in [*scans(rng, folder), *sweeps(rng, folder)]:
            failed |= wrong > 0
            print(f"{what:44} {count:9} {wrong:9}", flush=True)
        count, wrong = tags(folder)
        failed |= wrong > 0
        print(f"{'tags of all types':44} {count:9} {wrong:9}")
    sys.exit(1 if failed else 0)


if __name__ == "__main__":
    main()
