"""Clocks, logs and their gaps."""

import numpy as np
import pytest

from losbench.logs import FrameTimes, read_temperature_log, read_times

NOON = np.datetime64("2026-03-01T12:00:00", "ns")


def written(folder, text, name="log.csv"):
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


def test_a_log_is_interpolated_to_the_frames(tmp_path):
    log = read_temperature_log(written(tmp_path, "time_s,temperature_degC\n0,18\n100,20\n200,20\n"))
    celsius = log.at(FrameTimes(np.array([-1.0, 0.0, 50.0, 150.0, 200.0, 201.0, np.nan])))
    np.testing.assert_array_equal(celsius[:, 0], [np.nan, 18, 19, 20, 20, np.nan, np.nan])


def test_utc_log_and_utc_frames_share_the_clock(tmp_path):
    header = "time,temperature_room_degC,temperature_mirror_degC\n"
    rows = "2026-03-01T12:00:00Z,18,19\n2026-03-01T14:00:00+01:00,20,21\n"
    log = read_temperature_log(written(tmp_path, header + rows))
    assert log.names == ("temperature_room_degC", "temperature_mirror_degC")
    frames = FrameTimes(np.array([0.0]), NOON + np.timedelta64(30, "m"))
    np.testing.assert_allclose(log.at(frames), [[19.0, 20.0]])


def test_a_gap_gives_nan_and_its_edges_stay(tmp_path):
    rows = "".join(f"{t},{18 + t / 100}\n" for t in [*range(0, 50, 5), *range(500, 550, 5)])
    log = read_temperature_log(written(tmp_path, "time_s,temperature_degC\n" + rows))
    celsius = log.at(FrameTimes(np.array([44.0, 45.0, 46.0, 300.0, 499.0, 500.0])))[:, 0]
    assert np.isnan(celsius).tolist() == [False, False, True, True, True, False]
    assert np.isfinite(log.at(FrameTimes(np.array([300.0])), max_gap_s=1000.0)).all()


def test_of_two_clocks_that_of_the_frames_counts(tmp_path):
    rows = "".join(f"{10 * k},2026-03-01T12:{k:02d}:00Z,{18 + k}\n" for k in range(3))
    log = read_temperature_log(written(tmp_path, "time_s,time,temperature_degC\n" + rows))
    assert log.at(FrameTimes(np.array([5.0, 20.0])))[:, 0].tolist() == [18.5, 20]
    assert log.at(FrameTimes(np.array([30.0, 120.0]), NOON))[:, 0].tolist() == [18.5, 20]


def test_a_second_clock_that_cannot_be_read_is_no_hindrance(tmp_path):
    log = read_temperature_log(
        written(tmp_path, "time_s,time,temperature_degC\n0,noon,18\n10,later,19\n")
    )
    assert log.utc is None
    assert log.at(FrameTimes(np.array([5.0])))[:, 0].tolist() == [18.5]


def test_a_degree_sign_of_a_windows_logger_is_read(tmp_path):
    path = tmp_path / "log.csv"
    path.write_bytes("time_s,T (\N{DEGREE SIGN}C)\n0,18\n10,19\n".encode("cp1252"))
    log = read_temperature_log(path, columns={"temperature_degC": "T (\N{DEGREE SIGN}C)"})
    assert log.celsius[:, 0].tolist() == [18, 19]


def test_columns_can_be_named(tmp_path):
    path = written(tmp_path, "t,Room (C)\n0,18\n1,19\n")
    log = read_temperature_log(path, columns={"time_s": "t", "temperature_degC": "Room (C)"})
    assert log.celsius[:, 0].tolist() == [18, 19]


def test_rows_out_of_order_repeated_or_empty_are_put_right(tmp_path):
    log = read_temperature_log(
        written(tmp_path, "time_s,temperature_degC\n10,19\n0,18\n10,99\n20,\n")
    )
    assert log.times.seconds.tolist() == [0, 10]
    assert log.celsius[:, 0].tolist() == [18, 19]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "seconds,temperature_degC\n0,1\n",
            r"log.csv must have a column time_s .* or time .*; it has seconds, temp",
        ),
        (
            "time_s,room\n0,1\n",
            r"log.csv must have a column such as temperature_degC; it has time_s, room",
        ),
        (
            "time_s,temperature_degC\n0,1\n1,\n2,warm\n3,2\n",
            r"column 'temperature_degC' of log.csv must hold numbers, got 'warm', in line 4",
        ),
        (
            "time,temperature_degC\nyesterday,18\n",
            r"column 'time' of log.csv must be ISO 8601 UTC as 2026-03-01T12",
        ),
        ("time_s,temperature_degC\n", r"log.csv must hold at least one row below its header"),
        (
            "time_s,temperature_degC\n0,18\n",
            r"log.csv must hold at least two readings at different times, got 1",
        ),
        ("", r"log.csv must be a CSV file with a header line"),
    ],
)
def test_a_bad_log_is_refused_by_name(tmp_path, text, message):
    with pytest.raises(ValueError, match=message):
        read_temperature_log(written(tmp_path, text))


def test_a_mapping_to_no_column_lists_those_there_are(tmp_path):
    path = written(tmp_path, "t,T\n0,18\n1,19\n")
    with pytest.raises(
        ValueError, match=r"log.csv has no column 'Temp' for temperature_degC; it has t, T"
    ):
        read_temperature_log(path, columns={"temperature_degC": "Temp"})


def test_a_log_without_overlap_or_on_another_clock_is_refused(tmp_path):
    log = read_temperature_log(written(tmp_path, "time_s,temperature_degC\n0,18\n10,19\n"))
    with pytest.raises(
        ValueError,
        match=r"must overlap the frames in time: it runs from 0 to 10 s, the frames from 50 to",
    ):
        log.at(FrameTimes(np.array([50.0, 60.0])))
    with pytest.raises(
        ValueError, match=r"must share a clock, but of the two only frames came with UTC"
    ):
        log.at(FrameTimes(np.array([0.0]), NOON))


def test_frame_times_come_from_a_file_or_a_period(tmp_path):
    assert read_times(None, 3) is None
    np.testing.assert_array_equal(read_times(None, 3, period_s=5.0).seconds, [0, 5, 10])
    assert read_times(None, 3, period_s=5.0, start="2026-03-01T12:00:00Z").start == NOON
    path = written(tmp_path, "frame,time_s\n0,0\n1,4.9\n", "times.csv")
    np.testing.assert_array_equal(read_times(path, 2).seconds, [0, 4.9])
    with pytest.raises(
        ValueError, match=r"times.csv must have one row for each of 3 frames, got 2"
    ):
        read_times(path, 3)
    with pytest.raises(ValueError, match=r"start must be ISO 8601 UTC"):
        read_times(None, 3, period_s=5.0, start="noon")
    with pytest.raises(FileNotFoundError, match="no CSV file at"):
        read_times(tmp_path / "nowhere.csv", 3)


def test_a_dead_sensor_is_left_out_and_a_sparse_one_interpolated(tmp_path):
    text = "time_s,temperature_a_degC,temperature_b_degC,temperature_c_degC\n0,18,,20\n10,19,,\n20,20,,22\n"
    log = read_temperature_log(written(tmp_path, text))
    assert log.names == ("temperature_a_degC", "temperature_c_degC")
    np.testing.assert_array_equal(
        log.at(FrameTimes(np.array([10.0])), max_gap_s=60.0), [[19.0, 21.0]]
    )


def test_frame_times_must_increase(tmp_path):
    with pytest.raises(ValueError, match="times.csv must hold increasing times"):
        read_times(written(tmp_path, "time_s\n0\n5\n5\n", "times.csv"), 3)


def test_frame_times_have_columns_and_options_of_their_own(tmp_path):
    path = written(
        tmp_path, "Bild;Uhr\n1;01.03.2026 13:00:00\n2;01.03.2026 13:00:05\n", "times.csv"
    )
    with pytest.raises(ValueError, match=r"--times-column 'time=\.\.\.'"):
        read_times(path, 2)
    times = read_times(path, None, columns={"time": "Uhr"}, utc_offset="+01:00")
    assert times.start == NOON and times.seconds.tolist() == [0, 5]
    assert not times.notes
    assert read_times(times, 2) is times
    with pytest.raises(ValueError, match="times must have one row for each of 3 frames, got 2"):
        read_times(times, 3)
    assert "taken as UTC" in read_times(path, 2, columns={"time": "Uhr"}).notes[0]
    assert "taken as UTC" in read_times(None, 2, period_s=5.0, start="2026-03-01T12:00:00").notes[0]


def test_an_hour_twice_among_frame_times_is_named(tmp_path):
    text = "time\n2026-10-25 02:30\n2026-10-25 02:59\n2026-10-25 02:00\n"
    path = written(tmp_path, text, "times.csv")
    with pytest.raises(ValueError, match="increasing times.*an hour twice: name its zone"):
        read_times(path, 3)
    assert read_times(path, 3, utc_offset="Europe/Berlin").seconds.tolist() == [0, 1740, 1800]


def test_no_overlap_of_a_local_log_says_so(tmp_path):
    text = "time,temperature_degC\n2026-03-01 13:00,18\n2026-03-01 13:30,19\n"
    log = read_temperature_log(written(tmp_path, text))
    with pytest.raises(ValueError, match="if they are local, say utc_offset"):
        log.at(FrameTimes(np.array([0.0, 60.0]), NOON))
    told = read_temperature_log(written(tmp_path, text), utc_offset=1)
    assert told.at(FrameTimes(np.array([900.0]), NOON)).tolist() == [[18.5]]
