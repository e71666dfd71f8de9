#!/usr/bin/env python3
"""Compare Thorlabs APT messages with the package thorlabs-apt-protocol, byte for byte, in both directions.

Every message that the driver sends must have the bytes that the package makes from the same values. Every message that a
controller sends (built here after the package's parser: info, homed, completed, stopped, status, DC status) must be read by
Sunstone as the package reads it, and written back to the same bytes. Exits with 1 if a message differs.

`--power` changes one byte of every message in turn, which must be detected.
"""

import argparse
import re
import struct
import subprocess
import sys
from pathlib import Path

import environment

if __name__ == "__main__" and not {"-h", "--help"} & set(sys.argv):
    environment.enter()
    import thorlabs_apt_protocol as apt
    from thorlabs_apt_protocol.parsing import id_to_func

ROOT = Path(__file__).resolve().parent.parent
CONTROLLER, HOST = 0x50, 0x01


def ours(*hexes):
    """Return lines of Sunstone's output, split at the tab."""
    command = ["cargo", "run", "--release", "--quiet", "--example", "apt_messages", "--", *hexes]
    done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT, check=True)
    return [line.split("\t") for line in done.stdout.splitlines()]


def sent():
    """Return the bytes that the package sends for the same values."""
    to = {"dest": CONTROLLER, "source": HOST}
    on = to | {"chan_ident": 1}
    return {
        "hw_req_info": apt.hw_req_info(**to),
        "mod_identify": apt.mod_identify(**to, chan_ident=0),
        "mod_set_chanenablestate on": apt.mod_set_chanenablestate(**on, enable_state=1),
        "mod_set_chanenablestate off": apt.mod_set_chanenablestate(**on, enable_state=2),
        "hw_stop_updatemsgs": apt.hw_stop_updatemsgs(**to),
        "mot_set_velparams": apt.mot_set_velparams(**on, min_velocity=0, acceleration=366, max_velocity=1073542),
        "mot_move_home": apt.mot_move_home(**on),
        "mot_move_absolute": apt.mot_move_absolute(**on, position=86384),
        "mot_move_absolute back": apt.mot_move_absolute(**on, position=-1),
        "mot_move_stop": apt.mot_move_stop(**on, stop_mode=1),
        "mot_move_stop ramp": apt.mot_move_stop(**on, stop_mode=2),
        "mot_req_statusupdate": apt.mot_req_statusupdate(**on),
        "mot_req_dcstatusupdate": apt.mot_req_dcstatusupdate(**on),
        "mot_ack_dcstatusupdate": apt.mot_ack_dcstatusupdate(**to),
    }


def received():
    """Return messages of a controller by name."""
    def long(msgid, data):
        return struct.pack("<HHBB", msgid, len(data), HOST | 0x80, CONTROLLER) + data

    status = struct.pack("<HllL", 1, -86384, 12345, 0x80002410)
    info = struct.pack("<l8sH4B60sHHH", 27123456, b"KDC101\0\0", 16, 3, 0, 2, 0, b"\0" * 60, 1, 0, 1)
    return {
        "hw_get_info": long(0x0006, info),
        "mot_move_homed": struct.pack("<HBBBB", 0x0444, 1, 0, HOST, CONTROLLER),
        "mot_move_completed": long(0x0464, status),
        "mot_move_stopped": long(0x0466, status),
        "mot_get_statusupdate": long(0x0481, status),
        "mot_get_dcstatusupdate": long(0x0491, struct.pack("<HlhHL", 1, 86384, -120, 0, 0x80000420)),
    }


def numbers(text):
    return {int(n) for n in re.findall(r"-?\d+", text)}


def check(wrong=None):
    """Return the number of differences; with `wrong`, of messages whose bytes it changes."""
    differences = {}
    mine = {name: bytes.fromhex(h) for name, h in ours()}
    for name, want in sent().items():
        got = mine.get(name, b"")
        differences[f"sent {name}"] = got != (wrong(want) if wrong else want)
    theirs = received()
    lines = ours(*(data.hex() for data in theirs.values()))
    for (name, data), line in zip(theirs.items(), lines):
        parsed = id_to_func[struct.unpack_from("<H", data)[0]](wrong(data) if wrong else data)
        wanted = {v for k, v in parsed.items() if k in {"position", "serial_number"} and isinstance(v, int)}
        back = bytes.fromhex(line[1]) == (wrong(data) if wrong else data)
        differences[f"read {name}"] = not (back and wanted <= numbers(line[0]))
    return differences


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--power", action="store_true", help="check that planted errors are detected")
    options = parser.parse_args()
    if not options.power:
        found = check()
        for name, differs in found.items():
            print(f"{name:34} {'DIFFERS' if differs else 'equal'}")
        sys.exit(any(found.values()))

    def last_byte(data):
        return data[:-1] + bytes([data[-1] ^ 0x04])

    found = check(last_byte)
    missed = [name for name, differs in found.items() if not differs]
    print(f"{len(found)} messages with one bit changed: {len(found) - len(missed)} detected {missed or ''}")
    sys.exit(bool(missed))


if __name__ == "__main__":
    main()
