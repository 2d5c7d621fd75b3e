"""Directories of TIFF pages written entry by entry (TIFF 6.0, and BigTIFF): which are plain."""

import io
import struct
import tempfile

import numpy as np
import pytest

from losbench.recording.frames.plainpages import only_page, plain_page

BYTE, ASCII, SHORT, LONG, SLONG, LONG8 = 1, 2, 3, 4, 9, 16
FORMS = {BYTE: "B", ASCII: "B", SHORT: "H", LONG: "I", SLONG: "i", LONG8: "Q"}
ROWS, COLUMNS = 6, 5
AT = 1000  # where the directory lies
IMAGE = 200  # where the image does


def entries(**changes):
    """Tag: (type, values) of a plain page of sixteen bits."""
    size = ROWS * COLUMNS * 2
    known = {
        256: (SHORT, [COLUMNS]),
        257: (LONG, [ROWS]),
        258: (SHORT, [16]),
        259: (SHORT, [1]),
        262: (SHORT, [1]),
        273: (LONG, [IMAGE]),
        277: (SHORT, [1]),
        278: (LONG, [ROWS]),
        279: (LONG, [size]),
    }
    for name, value in changes.items():
        known[int(name[1:])] = value
    return {tag: value for tag, value in known.items() if value is not None}


def page_file(tags, *, order="<", big=False, following=0, end=None, repeated=()):
    """A file with that directory; values that do not fit into an entry lie behind it."""
    head, form, inside = (8, "Q", 8) if big else (2, "I", 4)
    listed = sorted([*tags.items(), *repeated])
    beyond = AT + head + len(listed) * (12 + 8 * big) + inside
    lists, body = b"", b""
    for tag, (kind, values) in listed:
        data = struct.pack(f"{order}{len(values)}{FORMS[kind]}", *values)
        held = data
        if len(data) > inside:
            held = struct.pack(order + form, beyond + len(lists))
            lists += data
        body += struct.pack(f"{order}HH{form}", tag, kind, len(values)) + held.ljust(inside, b"\0")
    first = (b"II" if order == "<" else b"MM") + struct.pack(
        f"{order}HHHQ" if big else f"{order}HI", *((43, 8, 0, AT) if big else (42, AT))
    )
    count = struct.pack(order + ("Q" if big else "H"), len(listed))
    whole = first.ljust(AT, b"\7") + count + body + struct.pack(order + form, following) + lists
    whole = whole.ljust(4000, b"\0")
    file = tempfile.TemporaryFile(buffering=0)  # noqa: SIM115 - closed with the test
    file.write(whole[:end])
    return file


def plain(**options):
    tags = {name: value for name, value in options.items() if name[0] == "t"}
    how = {name: value for name, value in options.items() if name[0] != "t"}
    with page_file(entries(**tags), **how) as file:
        return plain_page(file, AT)


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("big", [False, True])
@pytest.mark.parametrize("following", [0, 3000])
def test_a_page_says_where_it_lies_and_where_the_next_one_is(order, big, following):
    with page_file(entries(), order=order, big=big, following=following) as file:
        page, only = plain_page(file, AT), only_page(file)
    assert (page.offset, page.shape, page.following) == (IMAGE, (ROWS, COLUMNS), following)
    assert page.dtype == np.dtype(f"{order}u2")
    assert only == (page if following == 0 else None)
    assert page.holds((ROWS, COLUMNS), np.dtype(np.uint16))
    assert not page.holds((COLUMNS, ROWS), np.dtype(np.uint16))
    assert not page.holds((ROWS, COLUMNS), np.dtype(np.uint8))


@pytest.mark.parametrize(
    ("bits", "form", "dtype"),
    [
        (8, 1, "u1"),
        (16, 1, "u2"),
        (32, 1, "u4"),
        (32, 3, "f4"),
        (64, 3, "f8"),
        (12, 1, None),
        (16, 2, None),
        (16, 3, None),
        (64, 1, None),
    ],
)
def test_whole_unsigned_bytes_and_floats_are_plain(bits, form, dtype):
    size = ROWS * COLUMNS * bits // 8
    page = plain(t258=(SHORT, [bits]), t339=(SHORT, [form]), t279=(LONG, [size]))
    assert page is None if dtype is None else page.dtype == np.dtype(f"<{dtype}")


@pytest.mark.parametrize("kind", [BYTE, SHORT, LONG, LONG8])
@pytest.mark.parametrize("tag", [256, 258, 259, 262, 273, 277])
@pytest.mark.parametrize("big", [False, True])
def test_numbers_of_any_unsigned_type_are_read(kind, tag, big):
    value = entries()[tag][1]
    assert plain(**{f"t{tag}": (kind, value)}, big=big).offset == IMAGE


@pytest.mark.parametrize(
    ("tag", "value"),
    [
        (259, 5),
        (262, 0),
        (262, 2),
        (266, 2),
        (277, 3),
        (317, 2),
        (322, 16),
    ],
)
def test_what_is_packed_turned_or_tiled_is_not_plain(tag, value):
    assert plain(**{f"t{tag}": (SHORT, [value])}) is None


@pytest.mark.parametrize("tag", [256, 257, 258, 262, 273, 279])
def test_what_does_not_say_what_is_needed_is_not_plain(tag):
    assert plain(**{f"t{tag}": None}) is None
    assert plain(**{f"t{tag}": (ASCII, [1])}) is None
    assert plain(**{f"t{tag}": (SLONG, [1])}) is None


@pytest.mark.parametrize("tag", [259, 266, 277, 317, 339])
def test_what_is_not_said_is_plain(tag):
    assert plain(**{f"t{tag}": None}).shape == (ROWS, COLUMNS)


def test_several_bits_are_several_samples():
    assert plain(t258=(SHORT, [16, 16])) is None


ROW = 2 * COLUMNS


@pytest.mark.parametrize(
    ("begins", "counts", "whole"),
    [
        ([IMAGE, IMAGE + 4 * ROW], [4 * ROW, 2 * ROW], True),
        ([IMAGE, IMAGE + 2 * ROW, IMAGE + 4 * ROW], [2 * ROW] * 3, True),
        ([IMAGE, IMAGE + 4 * ROW + 1], [4 * ROW, 2 * ROW], False),
        ([IMAGE + 2 * ROW, IMAGE], [4 * ROW, 2 * ROW], False),
        ([IMAGE, IMAGE + 4 * ROW], [4 * ROW, 2 * ROW - 1], False),
        ([IMAGE, IMAGE + 4 * ROW], [6 * ROW], False),
        ([IMAGE], [6 * ROW + 1], False),
        ([0], [6 * ROW], False),
        ([1], [6 * ROW], True),
    ],
)
@pytest.mark.parametrize("big", [False, True])
def test_strips_are_one_piece_if_each_ends_where_the_next_begins(begins, counts, whole, big):
    page = plain(t273=(LONG, begins), t279=(LONG, counts), big=big)
    assert (page is not None) == whole
    if whole:
        assert page.offset == begins[0]


def test_an_image_of_no_rows_is_no_page():
    assert plain(t257=(LONG, [0]), t279=(LONG, [0])) is None


def test_an_image_ends_within_its_file():
    size = 2 * ROWS * COLUMNS
    assert plain(t273=(LONG, [4000 - size])).offset == 4000 - size
    assert plain(t273=(LONG, [4000 - size + 1])) is None


@pytest.mark.parametrize("big", [False, True])
def test_a_directory_ends_with_the_place_of_the_next(big):
    end = AT + (8 + 9 * 20 + 8 if big else 2 + 9 * 12 + 4)
    assert plain(big=big, end=end).offset == IMAGE
    assert plain(big=big, end=end - 1) is None
    assert plain(big=big, end=AT + 1) is None


def test_values_that_are_cut_off_are_none():
    begins = [IMAGE, IMAGE + 4 * ROW]
    counts = [4 * ROW, 2 * ROW]
    end = AT + 2 + 9 * 12 + 4 + 16
    strips = {"t273": (LONG, begins), "t279": (LONG, counts)}
    assert plain(**strips, end=end).offset == IMAGE
    assert plain(**strips, end=end - 1) is None


@pytest.mark.parametrize(("more", "read"), [(991, True), (992, False)])
def test_a_directory_may_have_a_thousand_entries(more, read):
    extra = {f"t{30000 + k}": (SHORT, [1]) for k in range(more)}
    tags = entries(**extra)
    assert len(tags) == 9 + more
    with page_file(tags, end=None) as file:
        file.seek(0, io.SEEK_END)
        file.write(bytes(20_000))
        assert (plain_page(file, AT) is not None) == read


def test_a_tag_that_stands_twice_or_counts_nothing_is_damage():
    assert plain(repeated=[(262, (SHORT, [1]))]) is None
    assert plain(t277=(SHORT, [])) is None
    assert plain(repeated=[(30000, (SHORT, [1])), (30000, (SHORT, [2]))]).offset == IMAGE


@pytest.mark.parametrize("head", [b"II", b"II*", b"MM\0+", b"XX*\0", b"II\0*", b""])
def test_what_begins_otherwise_is_no_tiff(head):
    with tempfile.TemporaryFile(buffering=0) as file:
        file.write(head)
        assert plain_page(file, 0) is None and only_page(file) is None
        file.write(bytes(100))
        assert only_page(file) is None
