#!/usr/bin/env python3
"""Compare Sunstone's SCPI with that of PyVISA, over TCP, in both directions.

1. PyVISA (its backend PyVISA-py) queries Sunstone's emulated laser: identity, numbers, errors, a block of bytes.
2. Sunstone's driver controls a laser simulated by PyVISA-sim, whose commands are defined below in PyVISA-sim's format. PyVISA-sim
   has no socket; a few lines here transfer data between a socket and PyVISA-sim.

Exits with 1 if a value differs. `--power` applies errors in both directions, which must be detected.
"""

import argparse
import socket
import subprocess
import sys
import tempfile
import threading
from pathlib import Path

import environment

if __name__ == "__main__" and not {"-h", "--help"} & set(sys.argv):
    environment.enter()
    import pyvisa

ROOT = Path(__file__).resolve().parent.parent
RUN = ["cargo", "run", "--release", "--quiet", "--example", "instrument_bytes", "--"]

DEVICE = r"""
spec: "1.1"
devices:
  laser:
    eom:
      TCPIP SOCKET:
        q: "\n"
        r: "\n"
    error:
      error_queue:
        - q: "SYST:ERR?"
          default: '0,"No error"'
          command_error: '-222,"Data out of range"'
    dialogues:
      - q: "*IDN?"
        r: "Peer,Played laser,77,2.1"
      - q: "*OPC?"
        r: "1"
      - q: "MEAS:POW?"
        r: "4.00E-03"
      - q: "SYST:INTL?"
        r: "1"
    properties:
      rate:
        default: 1000000.0
        getter:
          q: "SOUR:FREQ?"
          r: "{:.3E}"
        setter:
          q: "SOUR:FREQ {:s}"
        specs:
          type: float
          min: 1.0
          max: 5.0e+7
      output:
        default: "OFF"
        getter:
          q: "OUTP?"
          r: "{:s}"
        setter:
          q: "OUTP {:s}"
        specs:
          type: str
          valid: ["ON", "OFF"]
resources:
  TCPIP0::laser::5025::SOCKET:
    device: laser
"""

TABLE = """
address = "{address}"
nm = 635
rate_hz = [1.0, 8e7]
set_rate = "SOUR:FREQ {{hz}}"
ask_rate = "SOUR:FREQ?"
ask_power = "MEAS:POW?"
nominal_power = 5e-3
ask_interlock = "SYST:INTL?"
"""

WANTED = {
    "identify": "Peer Played laser 77 2.1",
    "on": "done",
    "state on": "true 2500000 0.8",
    "too fast": "-222",
    "off": "done",
    "state off": "false 2500000 0.8",
}


def carried(listener, session, change):
    """Transfer lines of one connection to PyVISA-sim and back."""
    stream, _ = listener.accept()
    with stream, stream.makefile("rb") as lines:
        for line in lines:
            command = line.decode().strip()
            session.write(command)
            if command.endswith("?"):
                stream.sendall(change(command, session.read()).encode() + b"\n")


def driven(change=lambda command, answer: answer):
    """Return the differences between what Sunstone's driver reads from PyVISA-sim's laser and the expected values."""
    with tempfile.TemporaryDirectory() as folder:
        played = Path(folder) / "laser.yaml"
        played.write_text(DEVICE)
        session = pyvisa.ResourceManager(f"{played}@sim").open_resource(
            "TCPIP0::laser::5025::SOCKET", read_termination="\n", write_termination="\n", timeout=2000)
        listener = socket.create_server(("127.0.0.1", 0))
        threading.Thread(target=carried, args=(listener, session, change), daemon=True).start()
        table = Path(folder) / "table.toml"
        table.write_text(TABLE.format(address=f"127.0.0.1:{listener.getsockname()[1]}"))
        done = subprocess.run([*RUN, "scpi-laser", table], capture_output=True, text=True, cwd=ROOT, check=True)
        session.close()
    found = dict(line.split("\t", 1) for line in done.stdout.splitlines())
    return {f"driver, {step}": found.get(step, "nothing") for step, want in WANTED.items() if not holds(step, want, found)}


def holds(step, want, found):
    got = found.get(step, "")
    return want in got if want.startswith("-") else got == want


def asked(wrong=False):
    """Return the differences between what PyVISA reads from Sunstone's emulator and the expected values; with `wrong`, expect
    other values.
    """
    with subprocess.Popen([*RUN, "scpi-emulator"], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, cwd=ROOT) as ours:
        host, port = ours.stdout.readline().strip().rsplit(":", 1)
        laser = pyvisa.ResourceManager("@py").open_resource(
            f"TCPIP0::{host}::{port}::SOCKET", read_termination="\n", write_termination="\n", timeout=3000)
        found = {"identity": laser.query("*IDN?"), "done": laser.query("*OPC?")}
        laser.write("SOUR:FREQ 3.25E6")
        laser.write("OUTP ON")
        found |= {"rate": laser.query_ascii_values("SOUR:FREQ?"), "on": laser.query("OUTP?")}
        found["two at once"] = laser.query("OUTP?;SOUR:FREQ?")
        found["no error"] = laser.query("SYST:ERR?")
        laser.write("SOUR:FREQ 1E12")
        laser.write("FOO")
        found["errors"] = [laser.query("SYST:ERR?").split(",")[0] for _ in range(3)]
        found["block"] = laser.query_binary_values("CURV?", datatype="B", container=list)
        laser.close()
        ours.stdin.close()
    wanted = {
        "identity": "Sunstone,Emulated laser,1,1.0",
        "done": "1",
        "rate": [3.25e6],
        "on": "1",
        "two at once": "1;3.25E6",
        "no error": '0,"No error"',
        "errors": ["-222", "-113", "0"],
        "block": [n % 256 for n in range(300)],
    }
    if wrong:
        wanted = {k: v + v[:1] for k, v in wanted.items()}
    return {f"emulator, {k}": found[k] for k in wanted if found[k] != wanted[k]}, len(wanted)


# Planted errors by name: the step that must detect the error, and the change of an answer.
PLANTED = {
    "another identity": ("driver, identify", lambda c, a: a.replace("77", "78") if c == "*IDN?" else a),
    "three fields of identity": ("driver, identify", lambda c, a: "Peer,Played,77" if c == "*IDN?" else a),
    "stays dark": ("driver, on", lambda c, a: "OFF" if c == "OUTP?" else a),
    "never goes off": ("driver, off", lambda c, a: "ON" if c == "OUTP?" else a),
    "an open interlock": ("driver, on", lambda c, a: "0" if c == "SYST:INTL?" else a),
    "another rate": ("driver, state on", lambda c, a: "2.501E+06" if c == "SOUR:FREQ?" else a),
    "no rate": ("driver, state on", lambda c, a: "9.91E+37" if c == "SOUR:FREQ?" else a),
    "half the power": ("driver, state on", lambda c, a: "2.00E-03" if c == "MEAS:POW?" else a),
    "errors without end": ("driver, on", lambda c, a: '-100,"x"' if c == "SYST:ERR?" else a),
    "errors kept quiet": ("driver, too fast", lambda c, a: '0,"No error"' if c == "SYST:ERR?" else a),
    "not done": ("driver, on", lambda c, a: "0" if c == "*OPC?" else a),
}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--power", action="store_true", help="check that planted errors are detected")
    options = parser.parse_args()
    if not options.power:
        differences, count = asked()
        differences |= driven()
        for name, got in differences.items():
            print(f"{name}: {got}")
        print(f"{count} answers of the emulator to PyVISA-py, {len(WANTED)} steps of the driver at PyVISA-sim: "
              f"{len(differences)} differ")
        sys.exit(bool(differences))

    missed = [name for name, (step, change) in PLANTED.items() if step not in driven(change)]
    differences, count = asked(wrong=True)
    print(f"{len(PLANTED)} planted errors: {len(PLANTED) - len(missed)} detected {missed or ''}; "
          f"{count} wrong expectations: {len(differences)} detected")
    sys.exit(bool(missed) or len(differences) < count)


if __name__ == "__main__":
    main()
