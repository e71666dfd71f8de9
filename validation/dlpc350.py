#!/usr/bin/env python3
"""Compare reports to the DLPC350 with those of the package pycrafter4500, byte for byte.

The package writes to a device that only stores the data; Sunstone prints what its driver writes for the same values. The package
writes the number of images as given. TI's own program writes this number minus one, so this script passes the number minus one.
Exits with 1 if a report differs. `--power` changes one bit in every message; each change must be detected.
"""

import argparse
import contextlib
import subprocess
import sys
from pathlib import Path

import environment

if __name__ == "__main__" and not {"-h", "--help"} & set(sys.argv):
    environment.enter()
    from pycrafter4500 import pycrafter4500 as peer

ROOT = Path(__file__).resolve().parent.parent


class Kept:
    """A device that stores written data."""

    def __init__(self):
        self.bytes = b""

    def write(self, _endpoint, data):
        assert len(data) == 64
        self.bytes += bytes(data)

    def read(self, _endpoint, size):
        return bytes(size)


def theirs():
    """Return the bytes that the package writes, by Sunstone's names of the messages."""
    plain = {"trig_type": 0, "pat_num": 0, "bit_depth": 1, "led_select": 2}
    flags = {"trig_type": 3, "pat_num": 23, "bit_depth": 1, "led_select": 7, "do_invert_pat": True,
             "do_insert_black": True, "do_buf_swap": True, "do_trig_out_prev": True}
    long = [0x5F, 0x71, 0x0F] * 128
    calls = {
        "display video": lambda d: d.set_display_mode("video"),
        "display pattern": lambda d: d.set_display_mode("pattern"),
        "source video": lambda d: d.set_pattern_input_source("video"),
        "source flash": lambda d: d.set_pattern_input_source("flash"),
        "trigger vsync": lambda d: d.set_pattern_trigger_mode("vsync"),
        "trigger internal": lambda d: d.set_pattern_trigger_mode(1),
        "trigger from outside": lambda d: d.set_pattern_trigger_mode(2),
        # The package does not support these messages; its generic command builds reports from codes and data like TI's program.
        "trigger output 1": lambda d: d.command("w", 0, 0x1A, 0x1D, [1, 0xBB, 0xD5]),
        "trigger output 2": lambda d: d.command("w", 0, 0x1A, 0x1E, [0, 0x7F]),
        "trigger input 1": lambda d: d.command("w", 0, 0x1A, 0x35, [0x03, 0x02, 0x07, 0x00]),
        "trigger input 2": lambda d: d.command("w", 0, 0x1A, 0x36, [1]),
        "stop": lambda d: d.pattern_display("stop"),
        "pause": lambda d: d.pattern_display("pause"),
        "start": lambda d: d.pattern_display("start"),
        "exposure": lambda d: d.set_exposure_frame_period(66051, 1000000),
        "config": lambda d: d.set_pattern_config(128, True, 3, 0),
        "mailbox images": lambda d: d.open_mailbox(1),
        "mailbox patterns": lambda d: d.open_mailbox(2),
        "mailbox closed": lambda d: d.open_mailbox(0),
        "address": lambda d: d.mailbox_set_address(5),
        "validate": lambda d: d.start_pattern_lut_validate(),
        "pattern plain": lambda d: d.send_pattern_lut(**plain),
        "pattern all flags": lambda d: d.send_pattern_lut(**flags),
        "pattern grey": lambda d: d.send_pattern_lut(2, 2, 8, 2),
        # The package sends one pattern at a time; this uses its division of long messages into reports.
        "pattern long": lambda d: d.command("w", 0, 0x1A, 0x34, long),
        "main status": lambda d: d.get_main_status(),
    }
    written = {}
    for name, call in calls.items():
        device = Kept()
        with contextlib.redirect_stdout(sys.stderr):
            call(peer.dlpc350(device))
        written[name] = device.bytes
    return written


def check(change=lambda data: data):
    """Return whether each message differs."""
    command = ["cargo", "run", "--release", "--quiet", "--example", "instrument_bytes", "--", "dlpc350"]
    done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT, check=True)
    ours = {name: bytes.fromhex(data) for name, data in (line.split("\t") for line in done.stdout.splitlines())}
    written = theirs()
    names = sorted(ours.keys() | written.keys())
    return {name: ours.get(name) != change(written.get(name, b"")) for name in names}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--power", action="store_true", help="check that planted errors are detected")
    options = parser.parse_args()
    if not options.power:
        found = check()
        for name, differs in found.items():
            print(f"{name:20} {'DIFFERS' if differs else 'equal'}")
        sys.exit(any(found.values()))

    missed, planted = [], 0
    # Flags, length, the command's code, and data.
    for place in [0, 2, 4, 5, 6]:
        found = check(lambda data, at=place: data[:at] + bytes([data[at] ^ 0x04]) + data[at + 1:])
        planted += len(found)
        missed += [f"{name} at {place}" for name, differs in found.items() if not differs]
    print(f"{planted} reports with one bit changed: {planted - len(missed)} detected {missed or ''}")
    sys.exit(bool(missed))


if __name__ == "__main__":
    main()
