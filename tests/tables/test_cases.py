"""CSV files as loggers, spreadsheets and people write them: read right, noted, or refused by a word.

In the texts / ends a line.
"""

import numpy as np
import pytest

from losbench.logs import read_temperature_log

HEADER = "time_s,temperature_degC/"
ROWS = "0,18.0/60,18.2/120,18.5/"
GERMAN = "0;18,0/60;18,2/120;18,5/"
UTC = "time,temperature_degC/"


def lines(text, end="\n", encoding="utf-8"):
    return text.replace("/", end).encode(encoding)


def dated(*times, header="time,temperature_degC\n", mark=","):
    rows = (f"{t}{mark}{c}\n" for t, c in zip(times, ("18.0", "18.2", "18.5"), strict=True))
    return (header + "".join(rows)).encode()


def read(tmp_path, content, **options):
    path = tmp_path / "log.csv"
    path.write_bytes(content)
    return read_temperature_log(path, **options)


DEGREE = "\N{DEGREE SIGN}"
FINE = {
    "plain": lines(HEADER + ROWS),
    "tabs": lines((HEADER + ROWS).replace(",", "\t")),
    "decimal commas": lines(HEADER.replace(",", ";") + GERMAN),
    "sep=": lines("sep=;/" + HEADER.replace(",", ";") + GERMAN),
    "bars": lines((HEADER + ROWS).replace(",", "|")),
    "utf-8 mark": lines("\N{ZERO WIDTH NO-BREAK SPACE}" + HEADER + ROWS),
    "utf-16": lines(HEADER + ROWS, encoding="utf-16"),
    "utf-16 without a mark": lines(HEADER + ROWS, encoding="utf-16-le"),
    "carriage returns": lines(HEADER + ROWS, end="\r"),
    "windows ends": lines(HEADER + ROWS, end="\r\n"),
    "quoted decimal commas": lines(HEADER + '0,"18,0"/60,"18,2"/120,"18,5"/'),
    "comma at the end of data": lines(HEADER + ROWS.replace("/", ",/")),
    "comma at every end": lines((HEADER + ROWS).replace("/", ",/")),
    "three commas at every end": lines((HEADER + ROWS).replace("/", ",,,/")),
    "a # in a name": lines("time_s,sample #,temperature_degC/0,1,18.0/60,2,18.2/120,3,18.5/"),
    "remarks": lines("# logger 7/" + HEADER + "0,18.0/# paused/60,18.2/120,18.5/"),
    "numpy.savetxt": lines("# time_s,temperature_degC/" + ROWS),
    "spaces after commas": lines((HEADER + ROWS).replace(",", ", ")),
    "empty lines": lines("/" + HEADER + "/0,18.0//60,18.2/120,18.5/,/"),
    "row of units": lines("time,temperature/s,degC/" + ROWS),
    "row of units in brackets": lines(
        "time,temperature,x/[s],[degC],[arcsec]/0,18.0,1/60,18.2,2/120,18.5,3/"
    ),
    "exponents": lines(HEADER + "0,1.80e1/6e1,182e-1/1.2E2,+18.5/"),
    "fahrenheit by name": lines("time_s,temp_F/0,64.4/60,64.76/120,65.3/"),
    "kelvin in brackets": lines("time_s,T [K]/0,291.15/60,291.35/120,291.65/"),
    "minutes": lines("time [min],T (" + DEGREE + "C)/0,18.0/1,18.2/2,18.5/"),
    "milliseconds": lines("time_ms;Temperatur (" + DEGREE + "C)/0;18,0/60000;18,2/120000;18,5/"),
}


@pytest.mark.parametrize("content", FINE.values(), ids=FINE)
def test_it_is_read_without_a_word(tmp_path, content):
    log = read(tmp_path, content)
    np.testing.assert_allclose(log.times.seconds, [0, 60, 120])
    np.testing.assert_allclose(log.celsius, [[18.0], [18.2], [18.5]], rtol=1e-12)
    assert log.notes == ()
    assert log.names[0].startswith("temperature") and log.names[0].endswith("_degC")


KEYS = "Serial,12345/Site,Lab/Start,2026-03-01/Interval,60/Sensors,1/"
NOTED = {
    "latin degree sign": (
        lines("time_s,T [" + DEGREE + "C]/" + ROWS[:-1], encoding="cp1252"),
        "last line has no end",
    ),
    "keys above": (lines(KEYS + HEADER + ROWS), "5 lines above the header are left out"),
    "words above": (lines("Site,Lab/Who,Ann/" + HEADER + ROWS), "2 lines above the header"),
    "cut last line": (lines(HEADER + ROWS + "18"), "the last line, 5, is cut off"),
    "event": (lines(HEADER + "0,18.0/Door opened/60,18.2/120,18.5/"), "lines of words between"),
    "event with commas": (lines(HEADER + "0,18.0/Door opened,/60,18.2/120,18.5/"), "words between"),
    "header again": (lines(HEADER + "0,18.0/" + HEADER + "60,18.2/120,18.5/"), "repetitions of"),
    "no line end": (lines(HEADER + ROWS[:-1]), "the last line has no end"),
    "joined and sorted": (lines(HEADER + "60,18.2/120,18.5/0,18.0/"), "go back once, in line 4"),
    "last reading first": (lines(HEADER + "120,18.5/60,18.2/0,18.0/"), "turned round"),
}


@pytest.mark.parametrize(("content", "note"), NOTED.values(), ids=NOTED)
def test_it_is_read_with_a_note(tmp_path, content, note):
    log = read(tmp_path, content)
    np.testing.assert_allclose(log.times.seconds, [0, 60, 120])
    np.testing.assert_allclose(log.celsius, [[18.0], [18.2], [18.5]], rtol=1e-12)
    assert any(note in said for said in log.notes), log.notes


HOBO = f'"Plot Title: 7"\n"No","Date Time, GMT+00:00","Temp, {DEGREE}C"\n'
CAMPBELL = (
    '"TOA5","lab","CR1000","1234"\n"TIMESTAMP","RECORD","T_Avg"\n"TS","RN","Deg C"\n"","","Avg"\n'
)
CLOCKS = {
    "iso": (dated("2026-03-01T12:00:00Z", "2026-03-01T12:01:00Z", "2026-03-01T12:02:00Z"), {}),
    "offsets": (dated("2026-03-01T13:00+01:00", "2026-03-01 13:01+0100", "2026-03-01T11:02-01"), {}),
    "compact": (dated("20260301T120000Z", "20260301T120100Z", "20260301T120200Z"), {}),
    "zone in the header": (
        dated("2026-03-01 13:00", "2026-03-01 13:01", "2026-03-01 13:02", header="Time (GMT+01:00),T [K]\n").replace(
            b"18.", b"291."
        ),
        None,
    ),
    "an offset told": (
        dated("2026-03-01 13:00", "2026-03-01 13:01", "2026-03-01 13:02"),
        {"utc_offset": 1},
    ),
    "a negative one": (
        dated("2026-03-01 08:30", "2026-03-01 08:31", "2026-03-01 08:32"),
        {"utc_offset": "-03:30"},
    ),
    "a zone told": (
        dated("2026-03-01 13:00", "2026-03-01 13:01", "2026-03-01 13:02"),
        {"utc_offset": "Europe/Berlin"},
    ),
    "date and time": (
        b"Date;Time;Temperature_degC\n01.03.2026;12:00;18,0\n01.03.2026;12:01;18,2\n01.03.2026;12:02;18,5\n",
        {"utc_offset": 0},
    ),
    "german": (
        "Datum;Uhrzeit;Temperatur (°C)\r\n01.03.2026;12:00:00;18,0\r\n01.03.2026;12:01:00;18,2\r\n"
        "01.03.2026;12:02:00;18,5\r\n".encode("cp1252"),
        {"utc_offset": 0},
    ),
    "points are day first": (
        dated("01.03.2026 12:00", "01.03.2026 12:01", "01.03.2026 12:02"),
        {"utc_offset": 0},
    ),
    "told to be day first": (
        dated("01/03/2026 12:00", "01/03/2026 12:01", "01/03/2026 12:02"),
        {"utc_offset": 0, "date_order": "dmy"},
    ),
    "told to be month first": (
        dated("3/1/2026 12:00", "3/1/2026 12:01", "3/1/2026 12:02"),
        {"utc_offset": 0, "date_order": "mdy"},
    ),
    "names of months": (
        dated("01-Mar-2026 12:00:00 PM", "01-Mar-2026 12:01:00 PM", "01-Mar-2026 12:02:00 PM"),
        {"utc_offset": 0},
    ),
    "campbell": (
        (CAMPBELL + '"2026-03-01 12:00:00",0,18.0\n"2026-03-01 12:01:00",1,18.2\n"2026-03-01 12:02:00",2,18.5\n').encode(),
        {"utc_offset": 0},
    ),
}  # fmt: skip


@pytest.mark.parametrize(("content", "options"), CLOCKS.values(), ids=CLOCKS)
def test_a_clock_is_read(tmp_path, content, options):
    log = read(tmp_path, content, **(options or {}))
    assert log.times.start == np.datetime64("2026-03-01T12:00")
    np.testing.assert_allclose(log.times.seconds, [0, 60, 120], atol=1e-6)
    if options is not None:
        np.testing.assert_allclose(log.celsius, [[18.0], [18.2], [18.5]], rtol=1e-12)
    assert not any("taken as UTC" in note for note in log.notes)


def test_a_logger_with_a_title_and_its_own_names_is_mapped_or_found(tmp_path):
    times = ("03/13/26 08:00:00 AM", "03/13/26 08:01:00 AM", "03/13/26 08:02:00 AM")
    rows = "".join(
        f"{k},{t},{c}\n" for k, (t, c) in enumerate(zip(times, (18.0, 18.2, 18.5), strict=True))
    )
    own = {"time": "Date Time, GMT+00:00", "temperature_degC": f"Temp, {DEGREE}C"}
    for columns in (own, None):
        log = read(tmp_path, (HOBO + rows).encode(), columns=columns)
        assert log.times.start == np.datetime64("2026-03-13T08:00")
        assert log.celsius[:, 0].tolist() == [18.0, 18.2, 18.5]
        assert log.names == ("temperature_degC",)


@pytest.mark.parametrize(
    ("times", "options", "start", "seconds"),
    [
        (("12/31/2025 23:59", "01/01/2026 00:00", "01/01/2026 00:01"), {}, "2025-12-31T23:59", [0, 60, 120]),
        (
            ("01-Mar-2026 12:59:00 PM", "01-Mar-2026 01:00:00 PM", "01-Mar-2026 01:01:00 PM"),
            {}, "2026-03-01T12:59", [0, 60, 120],
        ),
        (("2026-03-01 13:00", "2026-03-01 13:01", "2026-03-01 13:02"), {}, "2026-03-01T13:00", [0, 60, 120]),
        (
            ("2026-10-25 02:59", "2026-10-25 02:00", "2026-10-25 02:01"),
            {"utc_offset": "Europe/Berlin"}, "2026-10-25T00:59", [0, 60, 120],
        ),
        (
            ("2016-12-31T23:59:58Z", "2016-12-31T23:59:60Z", "2017-01-01T00:00:02Z"),
            {}, "2016-12-31T23:59:58", [0, 2, 5],
        ),
        (
            ("2017-01-01T00:59:58+01:00", "2017-01-01T00:59:60.5+01:00", "2017-01-01T01:00:02+01:00"),
            {}, "2016-12-31T23:59:58", [0, 2.5, 5],
        ),
        (
            ("2016-12-31T23:59:60Z", "2017-01-01T00:00:00Z", "2017-01-01T00:00:01Z"),
            {}, "2016-12-31T23:59:59", [1, 2, 3],
        ),
    ],
)  # fmt: skip
def test_what_a_clock_means(tmp_path, times, options, start, seconds):
    log = read(tmp_path, dated(*times), **options)
    assert log.times.start == np.datetime64(start)
    np.testing.assert_allclose(log.times.seconds, seconds, atol=1e-9)
    told = times[0][-1] == "Z" or "+" in times[0] or bool(options)
    assert told != any("taken as UTC" in note for note in log.notes)


def test_leap_seconds_are_those_of_the_earth_rotation_service():
    erfa = pytest.importorskip("erfa")
    from losbench.tables.moments import elapsed_s

    table = erfa.leap_seconds.get()
    for row in table[table["year"] >= 1981]:
        day = np.datetime64(f"{row['year']}-{row['month']:02d}-01")
        assert elapsed_s(day - np.timedelta64(1, "s"), day) == 2.0
    last = np.datetime64("2017-01-01")
    assert elapsed_s(np.datetime64("1980-01-01"), last) == float(
        (last - np.datetime64("1980-01-01")) / np.timedelta64(1, "s") + 18
    )


def test_times_come_back_as_utc_over_a_leap_second(tmp_path):
    log = read(
        tmp_path, dated("2016-12-31T23:59:58Z", "2016-12-31T23:59:59Z", "2017-01-01T00:00:02Z")
    )
    assert log.times.utc.astype("datetime64[s]").astype(str).tolist() == [
        "2016-12-31T23:59:58", "2016-12-31T23:59:59", "2017-01-01T00:00:02",
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("cell", "value", "note"),
    [
        ("#N/A", np.nan, ""),
        ("NaN", np.nan, ""),
        ("---", np.nan, ""),
        ("", np.nan, ""),
        ("-999", np.nan, "-999, which stands for none"),
        ("-127", np.nan, "-127, which stands for none"),
        ("9999", np.nan, "9999, which stands for none"),
        ("\N{MINUS SIGN}18.2", -18.2, ""),
        ("-998", None, "absolute zero"),
    ],
)
def test_what_a_cell_means(tmp_path, cell, value, note):
    content = f"{HEADER}0,18.0/60,{cell}/120,18.5/".replace("/", "\n")
    if cell == "#N/A":
        content = "time_s,temperature_degC\n0,18.0\n60,#N/A\n120,18.5\n"
    if value is None:
        with pytest.raises(ValueError, match=note):
            read(tmp_path, content.encode())
        return
    log = read(tmp_path, content.encode())
    assert log.celsius[:, 0].tolist() == [18.0, 18.5] if np.isnan(value) else [18.0, value, 18.5]
    assert any(note in said for said in log.notes) if note else log.notes == ()


def test_a_sentinel_of_the_user_s_own(tmp_path):
    log = read(tmp_path, lines(HEADER + "0,18.0/60,85/120,18.5/"), sentinel=85)
    assert log.times.seconds.tolist() == [0, 120]


REFUSED = {
    "another alphabet": ("time_s,\u6e29\u5ea6_degC/0,18.0/".replace("/", "\n").encode("gbk"), "encoding", {}),
    "decimal comma": (lines(HEADER + "0,18,0/60,18,2/"), "decimal comma", {}),
    "too many": (lines(HEADER + "0,18.0,30.0/60,18.2,30.2/"), "3 fields", {}),
    "too few": (lines("time_s,a,temperature_degC/0,1,18.0/60,18.2/120,3,18.5/"), "line 3 has 2 fields", {}),
    "day or month": (dated("03/04/2026 12:00", "03/04/2026 12:01", "03/04/2026 12:02"), "date_order", {}),
    "two orders": (dated("13/04/2026 12:00", "03/14/2026 12:01", "03/04/2026 12:02"), "another order", {}),
    "kelvin": (lines(HEADER + "0,291.15/60,291.35/120,291.65/"), "kelvin", {}),
    "too hot": (lines(HEADER + "0,18.0/60,500/120,18.5/"), "--unit", {}),
    "too cold": (lines(HEADER + "0,18.0/60,-500/120,18.5/"), "absolute zero", {}),
    "no unit": (lines("time_s,temperature/" + ROWS), "unit=", {}),
    "some offsets": (dated("2026-03-01T12:00:00Z", "2026-03-01T12:01:00", "2026-03-01T12:02:00"), "some", {}),
    "an hour twice": (
        dated("2026-10-25T02:00:00", "2026-10-25T02:30:00", "2026-10-25T02:10:00"), "zone", {},
    ),
    "no such hour": (
        dated("2026-03-29 01:30", "2026-03-29 02:30", "2026-03-29 03:30"), "does not exist", {"utc_offset": "Europe/Berlin"},
    ),
    "either hour": (
        dated("2026-10-25 01:00", "2026-10-25 02:30", "2026-10-25 03:30"), "twice", {"utc_offset": "Europe/Berlin"},
    ),
    "no such zone": (
        dated("2026-03-29 01:30", "2026-03-29 02:30", "2026-03-29 03:30"), "zone as", {"utc_offset": "Mars/Olympus"},
    ),
    "no leap second": (
        dated("2019-12-31T23:59:59Z", "2019-12-31T23:59:60Z", "2020-01-01T00:00:00Z"), "no leap second", {},
    ),
    "clock not set": (dated("0001-01-01T00:00:00Z", "0001-01-01T00:01:00Z", "0001-01-01T00:02:00Z"), "clock not set", {}),
    "the far future": (dated("2026-01-01T00:00:00Z", "9999-12-31T23:59:59Z", "2026-01-01T00:02:00Z"), "line 3", {}),
    "no such day": (dated("2026-02-28T00:00Z", "2026-02-30T00:00Z", "2026-03-01T00:00Z"), "no calendar", {}),
    "no such hour of the day": (dated("2026-02-28T00:00Z", "2026-02-28T25:00Z", "2026-03-01T00:00Z"), "no clock", {}),
    "numbers as times": (dated("1000", "1060", "1120"), "time_s", {}),
    "times as seconds": (
        dated("2026-03-01T12:00Z", "2026-03-01T12:01Z", "2026-03-01T12:02Z", header="time_s,temperature_degC\n"), "must hold seconds", {},
    ),
    "equal names": (lines("time_s,temperature_degC,temperature_degC/0,18,19/60,18,19/"), "two columns", {}),
    "infinity": (lines(HEADER + "0,18.0/60,inf/120,18.5/"), "numbers", {}),
    "huge": (lines(HEADER + "0,18.0/60,1e999/120,18.5/"), "numbers", {}),
    "underscores": (lines(HEADER + "0,18.0/60,1_8/120,18.5/"), "numbers", {}),
    "a letter": (lines(HEADER + "0,18.0/60,18.2x/120,18.5/"), "line 3", {}),
    "a letter at once": (lines(HEADER + "0,18.0x/60,18.2/120,18.5/"), "line 2", {}),
    "no header": (lines(ROWS), "header line", {}),
    "nothing": (b"", "is empty", {}),
    "a null byte": (lines(HEADER + "0,18.0/60,18\0.2/120,18.5/"), "null", {}),
    "thousands": (lines(HEADER.replace(",", ";") + "0;1,234/60;1,235/"), "thousands", {}),
    "own name": (lines("time_s,room/" + ROWS), "columns={", {}),
    "no clock": (lines("t,temperature_degC/" + ROWS), "columns={'time'", {}),
    "two steps back": (lines(HEADER + "60,18.0/0,18.2/120,18.5/90,18/"), "go back 2 times", {}),
    "spaces": (lines("time_s temperature_degC/0 18.0/60 18.2/"), "delimiter=space", {}),
    "an open quote": (lines(HEADER + '0,18.0/60,"18.2/120,18.5/'), "line", {}),
}  # fmt: skip


@pytest.mark.parametrize(("content", "word", "options"), REFUSED.values(), ids=REFUSED)
def test_it_is_refused_in_one_line_that_says_why(tmp_path, content, word, options):
    with pytest.raises(ValueError, match="log.csv|utc_offset") as refusal:
        read(tmp_path, content, **options)
    said = str(refusal.value)
    assert word in said, said
    assert "\n" not in said and len(said) < 400


def test_a_delimiter_an_encoding_and_a_unit_can_be_told(tmp_path):
    spaced = lines("time_s temperature_degC/0   18.0/60  18.2/120 18.5/")
    assert read(tmp_path, spaced, delimiter="space").celsius[:, 0].tolist() == [18.0, 18.2, 18.5]
    thousandths = lines("time_s;temperature_degC/0;18,000/60;18,200/120;18,500/")
    assert read(tmp_path, thousandths, decimal=",").celsius[:, 0].tolist() == [18.0, 18.2, 18.5]
    beside = lines("time_s;temperature_degC;x/0;18,000;1,5/60;18,200;2/")
    assert read(tmp_path, beside).celsius[:, 0].tolist() == [18.0, 18.2]
    chinese = "time_s,\u6e29\u5ea6\n0,18.0\n60,18.2\n120,18.5\n".encode("gbk")
    log = read(tmp_path, chinese, encoding="gbk", columns={"temperature_degC": "\u6e29\u5ea6"})
    assert log.celsius[:, 0].tolist() == [18.0, 18.2, 18.5]
    hot = lines("time_s,temperature/0,64.4/60,64.76/120,65.3/")
    log = read(tmp_path, hot, unit={"temperature": "degF"})
    np.testing.assert_allclose(log.celsius[:, 0], [18.0, 18.2, 18.5])
    assert (
        read(tmp_path, lines(HEADER + "0,300/60,300/"), unit={"temperature_degC": "degC"}).celsius[
            0
        ]
        == 300
    )


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"delimiter": ";;"}, "delimiter must be one character"),
        ({"decimal": "'"}, "decimal must be one of ',', '.'"),
        ({"encoding": "klingon"}, "encoding must be one that Python knows"),
        ({"date_order": "ydm"}, "date_order must be one of 'dmy', 'mdy', 'ymd'"),
        ({"utc_offset": 25}, "utc_offset must be a finite number from -14 to 14"),
        ({"sentinel": "none"}, "sentinel must be a number"),
        (
            {"unit": {"temperature_degC": "furlong"}},
            "unit of 'temperature_degC' must be one such as",
        ),
    ],
)
def test_an_option_that_means_nothing_is_named(tmp_path, options, message):
    with pytest.raises(ValueError, match=message):
        read(tmp_path, FINE["plain"], **options)


def test_an_hour_that_is_missing_is_named(tmp_path):
    minutes = [*range(100, 120), *range(180, 200)]
    rows = "".join(f"2026-03-29T{m // 60:02d}:{m % 60:02d}:00,18.{m}\n" for m in minutes)
    notes = read(tmp_path, (UTC.replace("/", "\n") + rows).encode()).notes
    assert any("before line 22 an hour is missing" in note for note in notes)
    told = read(tmp_path, (UTC.replace("/", "\n") + rows).encode(), utc_offset="Europe/Berlin")
    assert told.notes == () and np.ptp(np.diff(told.times.seconds)) < 1e-9
