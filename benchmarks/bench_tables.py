"""A log of a million rows, with rules and checks, beside the processor time that it may take and
beside pandas, which has neither.
"""

import tempfile
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
from records import growth
from side_by_side import in_turn, one_thread, report, within

from losbench.logs import read_temperature_log

ROWS = 1_000_000
LIMIT_S = 5.0
SIZES = (100, 1000, 10_000, 100_000)


def written(path: Path, rows: int) -> Path:
    start = np.datetime64("2026-03-01T00:00:00", "ms")
    utc = np.datetime_as_string(start + np.arange(rows) * np.timedelta64(500, "ms"))
    with path.open("w") as file:
        file.write("time,temperature_a_degC,temperature_b_degC\n")
        file.writelines(
            f"{t}Z,{18 + k % 97 / 100:.2f},{20 + k % 53 / 50:.3f}\n" for k, t in enumerate(utc)
        )
    return path


def main() -> None:
    one_thread()
    with tempfile.TemporaryDirectory() as folder:
        path = written(Path(folder, "log.csv"), ROWS)
        ours, peer = in_turn(
            lambda: read_temperature_log(path),
            lambda: pd.to_datetime(pd.read_csv(path)["time"], format="ISO8601", utc=True),
            3,
        )
        slow = growth(
            "a temperature log",
            "rows",
            SIZES,
            lambda n: partial(read_temperature_log, written(Path(folder, f"{n}.csv"), n)),
        )
    rows = [
        within("log of 1e6 rows", ours, "5 s of processor time", LIMIT_S, 1.0),
        within("log of 1e6 rows", ours, "pandas.read_csv and to_datetime", peer, 8.0),
    ]
    report("tables", rows, growths=[slow])


if __name__ == "__main__":
    main()
