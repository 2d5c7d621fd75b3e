"""Tables and descriptions for ``fuzz.py``: whole ones of every kind, and what reads a damaged one.

``python benchmarks/fuzz.py log --cases 10000``
"""

import tempfile
from functools import cache
from pathlib import Path

import losbench as lb
from losbench.logs import read_temperature_log, read_times
from losbench.papers.ren2023.export import write_telemetry
from losbench.papers.ren2023.scenario import Pair
from losbench.resources import data_file
from losbench.telemetry.columns import TelemetryFormat
from losbench.telemetry.read import read_telemetry
from losbench.workbench.ledger.claims import read_claims

UTC = [f"2026-03-01T12:00:{k:02d}Z" for k in range(12)]
CAMERA = """focal_mm = 260.0
pixel_um = 10.0
shape = [1080, 1920]
principal_px = [959.5, 539.5]

[detector]
gain_e_per_dn = 4.0
read_noise_e = 5.0
offset_dn = 100.0
bits = 12
full_well_e = 9e4
prnu = 0.01
prnu_seed = 0
hot_pixels = [[812, 40, 9e3]]
"""
HIP2 = "{k} 1 5 0 {ra:.10f} {dec:.10f} 5.0 100.0 -200.0 1 1 1 1 1 1 1 1 1 1 5.5 0.1 0.1 1 0.5\n"
HIP1 = "H|{k}| | | | | | |{ra:012.8f}|{dec:+.8f}| |5.0|-100.0|200.0|" + "|" * 30 + "5.5|" + "|" * 9
TYC2 = "0001 {k:05d} 1| |{ra:012.8f}|{dec:+.8f}|-16.3|-9.0|" + "|" * 13 + "12.1|" + "|" * 12


def log():
    rows = "".join(f"{k},{t},{18 + k / 8},{20 - k / 8}\n" for k, t in enumerate(UTC))
    german = "".join(f"01.03.2026;12:{k:02d}:00;{18 + k};1{k},5\r\n" for k in range(12))
    return {
        "plain.csv": f"time_s,time,temperature_plate_degC,temperature_degC\n{rows}".encode(),
        "german.csv": f"Datum;Uhrzeit;T (°C);Druck\r\n{german}".encode("cp1252"),
        "fahrenheit.csv": b"time_s,temp_F\n0,64.4\n60,64.8\n120,65.3\n",
        "unicode.csv": "time_s,T [K]\n0,291.1\n60,291.2\n".encode("utf-16"),
        "dates.csv": b"time,T [K]\n3/13/26 8:00 AM,291.1\n3/13/26 8:01 AM,291.2\n",
    }


def times():
    return {
        "utc.csv": "\n".join(["time", *UTC]).encode(),
        "seconds.csv": b"frame,time_s\n0,0.0\n1,5.0\n2,12.0\n",
    }


def pair():
    with tempfile.TemporaryDirectory() as folder:
        setting = Pair(days=(0.0,), track_s=4.0)
        written = write_telemetry(Path(folder, "pair"), seed=1, setting=setting)
        names = ("telemetry.csv", "telemetry.toml")
        return {name: (written / name).read_bytes() for name in names}


@cache
def form():
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "telemetry.toml")
        path.write_bytes(pair()["telemetry.toml"])
        return TelemetryFormat.from_toml(path)


def camera(path):
    lb.Camera.from_toml(path)
    lb.Detector.from_toml(path)


def stars(name, row, scale):
    rows = [row.format(k=k, ra=scale * k / 9, dec=scale * (k - 5) / 9) for k in range(1, 9)]
    return lambda: {name: "\n".join(line.rstrip() for line in rows).encode()}


def named(read):
    """Read a file, whose name every refusal must hold."""

    def reading(path):
        try:
            read(path)
        except ValueError as error:
            if path.name not in str(error):
                raise AssertionError(f"no file is named: {error}") from error
            raise

    return reading


# A door: how its whole files are made, and what reads one.
DOORS = {
    name: (lambda make=make: (make(), {}), named(read))
    for name, make, read in (
        ("log", log, read_temperature_log),
        ("times", times, lambda path: read_times(path, None)),
        (
            "telemetry",
            lambda: {"telemetry.csv": pair()["telemetry.csv"]},
            lambda path: read_telemetry(path, form()),
        ),
        (
            "columns",
            lambda: {"telemetry.toml": pair()["telemetry.toml"]},
            TelemetryFormat.from_toml,
        ),
        ("camera", lambda: {"camera.toml": CAMERA.encode()}, camera),
        (
            "claims",
            lambda: {"claims.csv": data_file("claims.csv").read_bytes()[:2000]},
            read_claims,
        ),
        ("hip2", stars("hip2.dat", HIP2, 1.0), lb.load_catalogue),
        ("hip1", stars("hip_main.dat", HIP1, 57.0), lb.load_catalogue),
        ("tyc2", stars("tyc2.dat", TYC2, 57.0), lb.load_catalogue),
    )
}
