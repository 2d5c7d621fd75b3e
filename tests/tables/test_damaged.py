"""Damaged files that once ended in something else than one line."""

import pytest

from losbench.logs import read_temperature_log, read_times


@pytest.mark.parametrize(
    ("content", "reader", "message"),
    [
        (
            b"time_s,time,temperature_degC\n0,2026-0H-01T12:00:00Z,18.0\n"
            b"0,2026-03-01T12:00:01Z,T\x8c\xd0:\xaf_\xc2)F\xdd\n",
            read_temperature_log,
            "damaged.csv",
        ),
        (b"frame,time_s\n\xb5,0.0\n1,5.nan12.0\n", lambda path: read_times(path, 2), "damaged.csv"),
        (
            b"time\n2026-03-01T12:00:00Z\n1/2\n[[1,2],[3]]\n",
            lambda path: read_times(path, 3),
            "line 4",
        ),
        (
            b"time\n9999-12-31T23:59:59Z\n2026-03-01T12:00:01Z\n",
            lambda path: read_times(path, 2),
            "line 2",
        ),
        (
            b"time_s,time,temperature_degC\n-1,200.5,21\n0.5,2026-03-01T12:00:02Z,22\n5,x,20x104\n",
            read_temperature_log,
            "'20x104', in line 4",
        ),
        (
            b"time_s,temperature_degC\n-1,21\n2,22\n5,2026-03-0" + bytes(40),
            read_temperature_log,
            "null bytes",
        ),
        (
            b"time_s\n0\n1" + b"9" * 800 + b"\n",
            lambda path: read_times(path, 2),
            "too large for one",
        ),
    ],
    ids=["contradictory", "no row fits", "an array", "far future", "number", "zeros", "huge"],
)
def test_it_is_refused_in_one_line(tmp_path, content, reader, message):
    path = tmp_path / "damaged.csv"
    path.write_bytes(content)
    with pytest.raises(ValueError, match="damaged.csv") as refusal:
        reader(path)
    assert message in str(refusal.value) and "\n" not in str(refusal.value)
    assert len(str(refusal.value)) < 400
