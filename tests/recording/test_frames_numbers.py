"""Numbers that the readers of frames promise, from either side."""

import bz2
import gzip
import struct
from pathlib import Path

import cv2
import files_of_frames as write
import numpy as np
import pytest

import losbench as lb
from losbench.recording.frames.develop import left_aligned_step
from losbench.recording.frames.names import belonging, jump_in_names, times_in_names
from losbench.recording.frames.packed import unpacked, unpacked_gige
from losbench.recording.frames.pixelfiles import _detector
from losbench.recording.frames.protocol import cut_short, fits_in
from losbench.recording.frames.raw import RawLayout

fits = pytest.importorskip("astropy.io.fits")
FRAMES = np.random.default_rng(7).integers(0, 4000, (6, 20, 30)).astype(np.uint16)
MEBIBYTE = 2**20


def read(path, **options):
    frames = lb.open_frames(path, **options)
    return frames.read(0, frames.n_frames)


# Numbers of the sensor


@pytest.mark.parametrize(("codes", "step"), [(15, 1), (16, 16)])
def test_sixteen_codes_that_occur_twice_tell_a_step(codes, step):
    frame = np.repeat(16 * np.arange(codes), 2).astype(np.uint16)
    assert left_aligned_step(np.append(frame, 16 * 900 + 1).astype(np.uint16)) == step


def test_a_code_that_occurs_twice_counts():
    frame = np.repeat(16 * np.arange(40), 2)
    assert left_aligned_step(np.append(frame, [1, 1]).astype(np.uint16)) == 1


@pytest.mark.parametrize("dtype", [np.uint16, np.int32])
@pytest.mark.parametrize("bits", [9, 10, 11, 12, 13, 14, 15])
@pytest.mark.parametrize("full", [1, 2])
def test_the_end_of_a_converter_is_shared_by_two_pixels(dtype, bits, full):
    """Cameras have 10, 12 or 14 bits; one pixel alone may be a glint, or a hot one."""
    frames = np.random.default_rng(bits).integers(0, 2**bits - 1, (1, 20, 30)).astype(dtype)
    frames[0, 0, :full] = 2**bits - 1
    converter = bits in (10, 12, 14) and full == 2
    expected = 2**bits - 1 if converter else np.iinfo(dtype).max
    assert lb.open_frames(frames).full_scale_dn == expected


@pytest.mark.parametrize("bits", [10, 12, 14])
def test_a_left_aligned_converter_ends_at_its_own_bits(bits):
    step = 2 ** (16 - bits)
    frames = step * np.random.default_rng(bits).integers(0, 2**bits - 1, (1, 90, 90))
    found = lb.open_frames(frames.astype(np.uint16))
    assert (found.step, found.full_scale_dn) == (step, 2**bits - 1)


def test_light_has_no_full_scale_and_wide_integers_their_own():
    assert lb.open_frames(FRAMES.astype(np.float64)).full_scale_dn is None
    assert lb.open_frames(FRAMES.astype(np.int8)).full_scale_dn == 127
    assert lb.open_frames(FRAMES.astype(np.uint32)).full_scale_dn == 2**32 - 1


# Channels


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32])
@pytest.mark.parametrize("channel", [0, 2])
@pytest.mark.parametrize("off", [1, -1])
def test_channels_of_exact_frames_are_one_only_if_they_are_equal(dtype, channel, off):
    grey = np.repeat((FRAMES % 200 + 10).astype(dtype)[..., None], 3, axis=-1)
    frames = lb.open_frames(grey)
    np.testing.assert_array_equal(frames.read(0, 6), FRAMES % 200 + 10)
    assert frames.dtype == dtype
    apart = grey.copy()
    apart[0, 3, 4, channel] = int(grey[0, 3, 4, channel]) + off
    with pytest.raises(lb.UnreadableFrame, match="3 colour channels that differ"):
        lb.open_frames(apart)


@pytest.mark.parametrize("suffix", [".jpg", ".png"])
@pytest.mark.parametrize("apart", [0, 2, 6])
def test_channels_of_lossy_images_may_differ_by_two(tmp_path, suffix, apart):
    """A flat field is what a JPEG keeps exactly, but for the rounding of its colours."""
    flat = np.full((16, 16, 3), 100, np.uint8)
    flat[..., 2] += apart
    folder = write.images(tmp_path / "a", [flat], suffix)
    decoded = cv2.imread(str(folder / f"frame-0{suffix}")).astype(int)
    differ = np.abs(decoded - decoded[..., 1:2]).max()
    if differ <= (2 if suffix == ".jpg" else 0):
        np.testing.assert_array_equal(read(folder)[0], decoded[..., 1])
    else:
        with pytest.raises(lb.UnreadableFrame, match="3 colour channels that differ"):
            lb.open_frames(folder)


@pytest.mark.parametrize("channels", [1, 2, 3, 4, 5])
def test_a_channel_is_taken_by_its_number_and_named_by_its_colour(channels):
    stack = np.stack([FRAMES + k for k in range(channels)], axis=-1)
    for k in range(channels):
        frames = lb.open_frames(stack, channel=k)
        np.testing.assert_array_equal(frames.read(0, 6), FRAMES + k)
        name = ("red", "green", "blue")[k] if channels > 2 and k < 3 else str(k)
        said = f"Of the {channels} channels of memory the one called {name} is measured."
        assert frames.notes == ((said,) if channels > 1 else ())
    for wrong in (channels, -1, True):
        with pytest.raises(ValueError, match=f"a number below the {channels} channels"):
            lb.open_frames(stack, channel=wrong)


def test_transparency_beside_colour_is_dropped_if_it_is_the_same_everywhere():
    grey = np.repeat(FRAMES[..., None], 4, axis=-1)
    grey[..., 3] = 255
    np.testing.assert_array_equal(read(grey), FRAMES)
    grey[0, -1, -1, 3] = 254
    with pytest.raises(lb.UnreadableFrame, match="transparency that is not the same everywhere"):
        lb.open_frames(grey)
    with pytest.raises(lb.UnreadableFrame, match="5 colour channels that differ"):
        lb.open_frames(np.repeat(FRAMES[..., None], 5, axis=-1))


# What a header may claim


@pytest.mark.parametrize("held", [0, 10, MEBIBYTE])
def test_a_frame_may_claim_64_mebibytes_or_1100_times_its_file(held):
    most = max(64 * MEBIBYTE, 1100 * held)
    fits_in("a", most, held)
    with pytest.raises(lb.UnreadableFrame, match=f"a file of {held:_} bytes cannot hold"):
        fits_in("a", most + 1, held)


def test_one_frame_that_is_there_is_kept_and_none_is_not():
    assert cut_short("a", 2, 2, skip=False) == (2, ())
    assert cut_short("a", 2, 3, skip=False) == (2, ())
    assert cut_short("a", 2, 1, skip=True)[0] == 1
    with pytest.raises(lb.UnreadableFrame, match="^a is cut short after frame 0 of 2$"):
        cut_short("a", 2, 0, skip=True)
    with pytest.raises(lb.UnreadableFrame, match="after frame 1 of 2: skip what is unreadable"):
        cut_short("a", 2, 1, skip=False)


# Packed bits


@pytest.mark.parametrize("high_first", [False, True])
@pytest.mark.parametrize("bits", [10, 12, 14])
@pytest.mark.parametrize("columns", [1, 2, 3, 4, 5, 8, 13])
def test_packed_numbers_come_back_however_many(bits, columns, high_first):
    order = "big" if high_first else "little"
    numbers = np.random.default_rng(columns).integers(0, 2**bits, (3, columns)).astype("<u2")
    numbers[0], numbers[1] = 0, 2**bits - 1
    as_bytes = (numbers.byteswap() if high_first else numbers).view(np.uint8)
    each = np.unpackbits(as_bytes.reshape(3, columns, 2), axis=-1, bitorder=order)
    each = each[..., 16 - bits :] if high_first else each[..., :bits]
    lines = np.packbits(each.reshape(3, -1), axis=-1, bitorder=order)
    found = unpacked(lines, bits, columns, high_first=high_first)
    np.testing.assert_array_equal(found, numbers)
    assert found.shape == (3, columns)


@pytest.mark.parametrize("bits", [10, 12])
@pytest.mark.parametrize("columns", [1, 2, 3, 6])
def test_packed_numbers_of_gige_vision_come_back(bits, columns):
    """GigE Vision 2.0: the high eight bits of both outside, their low ones in the middle byte."""
    numbers = np.random.default_rng(columns).integers(0, 2**bits, (2, columns))
    low = bits - 8
    padded = np.concatenate([numbers, np.zeros((2, columns % 2), int)], axis=-1)
    first, second = padded[:, 0::2], padded[:, 1::2]
    middle = first % 2**low + 16 * (second % 2**low)
    lines = np.stack([first >> low, middle, second >> low], axis=-1).reshape(2, -1)
    np.testing.assert_array_equal(unpacked_gige(lines.astype(np.uint8), bits, columns), numbers)


@pytest.mark.parametrize(
    ("pixels", "frame_bytes"),
    [
        ("mono8", 15),
        ("mono10", 30),
        ("mono12", 30),
        ("mono14", 30),
        ("mono16", 30),
        ("mono10p", 19),
        ("mono12p", 23),
        ("mono14p", 27),
        ("mono10packed", 24),
        ("mono12packed", 24),
    ],
)
@pytest.mark.parametrize("gap", [0, 4])
def test_raw_frames_lie_where_their_layout_says(tmp_path, pixels, frame_bytes, gap):
    """Fifteen pixels; the gap after the last frame may be there or not."""
    (tmp_path / "a.toml").write_text(
        f'file = "a.raw"\npixels = "{pixels}"\nshape = [3, 5]\nheader_bytes = 9\ngap_bytes = {gap}\n'
    )
    body = bytes(9) + (bytes(frame_bytes) + bytes(gap)) * 2 + b"\1" * frame_bytes
    for after in (b"", bytes(gap)):
        (tmp_path / "a.raw").write_bytes(body + after)
        frames = lb.open_frames(tmp_path / "a.toml")
        assert frames.n_frames == 3
        stack = frames.read(0, 3)
        assert not stack[:2].any() and stack[2].all()
        bits = int("".join(filter(str.isdigit, pixels)))
        assert frames.full_scale_dn == 2**bits - 1
    (tmp_path / "a.raw").write_bytes(body[:-1])
    with pytest.raises(lb.UnreadableFrame, match=r"a.raw is cut short after frame 2 of 3"):
        lb.open_frames(tmp_path / "a.toml")
    (tmp_path / "a.raw").write_bytes(b"1234567")
    with pytest.raises((lb.UnreadableFrame, ValueError), match=r"a.raw"):
        lb.open_frames(tmp_path / "a.toml")


@pytest.mark.parametrize("file", ["", 7, None])
def test_a_raw_file_must_have_a_name(file):
    with pytest.raises(ValueError, match=f"file must be the name of the raw file, got {file!r}"):
        RawLayout(file=file, pixels="mono8", shape=(3, 5))


def test_a_raw_frame_has_a_million_rows_and_columns_at_most():
    assert RawLayout(file="a.raw", pixels="mono8", shape=(2**20, 1)).frame_bytes == 2**20
    with pytest.raises(ValueError, match="shape must be"):
        RawLayout(file="a.raw", pixels="mono8", shape=(1, 2**20 + 1))


# FITS


def test_a_compressed_image_claims_no_more_than_its_file_can_hold(tmp_path):
    path = tmp_path / "a.fits"
    fits.HDUList([fits.PrimaryHDU(), fits.CompImageHDU(FRAMES[0].astype(np.int16))]).writeto(path)
    whole = path.read_bytes()
    assert read(path).shape == (1, 20, 30)
    for name in (b"ZNAXIS1", b"ZNAXIS2"):
        at = whole.index(name + b" =")
        whole = whole[:at] + name + b" =               900000" + whole[at + 30 :]
    path.write_bytes(whole)
    with pytest.raises(lb.UnreadableFrame, match="its header claims 1_620_000_000_000 bytes"):
        lb.open_frames(path)


def test_pixels_without_an_error_tell_nothing_of_a_gain():
    flux = np.linspace(1.0, 1000.0, 50)
    told = np.stack([flux, flux / 4.0 + 9.0])
    unknown = np.stack([np.full(50, 500.0), np.full(50, np.nan)])
    found = _detector(np.concatenate([told, unknown, unknown[::-1]], axis=1))
    assert found is not None and found == _detector(told)
    assert _detector(unknown) is None


# SER


@pytest.mark.parametrize(("colour", "order"), [(100, slice(None)), (101, slice(None, None, -1))])
def test_colours_of_ser_are_red_first_as_100_and_blue_first_as_101(tmp_path, colour, order):
    light = np.stack([FRAMES // 16, FRAMES // 8, FRAMES // 4], axis=-1)
    path = write.ser(tmp_path / "a.ser", light[..., order], colour=colour)
    for k, name in enumerate(("red", "green", "blue")):
        np.testing.assert_array_equal(read(path, channel=name), light[..., k])


@pytest.mark.parametrize("depth", [1, 8, 9, 16])
def test_ser_holds_1_to_16_bits_in_one_byte_up_to_8(tmp_path, depth):
    frames = np.broadcast_to(np.arange(30.0) / 29 * (2**depth - 1), (2, 20, 30))
    frames = frames.astype(np.uint8 if depth <= 8 else np.uint16)
    path = write.ser(tmp_path / "a.ser", frames, depth=depth)
    np.testing.assert_array_equal(read(path), frames)
    assert lb.open_frames(path).full_scale_dn == 2**depth - 1
    whole = bytearray(path.read_bytes())
    for at, value in ((34, 0), (34, 17), (26, 0), (30, 0), (38, 0)):
        bad = whole[:at] + struct.pack("<i", value) + whole[at + 4 :]
        path.write_bytes(bad)
        with pytest.raises(lb.UnreadableFrame, match=r"a.ser cannot be read: its header claims"):
            lb.open_frames(path)


@pytest.mark.parametrize("shape", [(2, 1, 30), (2, 20, 1), (1, 20, 30)])
def test_ser_may_hold_one_row_one_column_or_one_frame(tmp_path, shape):
    frames = FRAMES.ravel()[: np.prod(shape)].reshape(shape) // 16
    path = write.ser(tmp_path / "a.ser", frames.astype(np.uint8), depth=8)
    np.testing.assert_array_equal(read(path), frames)


@pytest.mark.parametrize(
    ("first", "step", "used"),
    [(0, 1, False), (1, 1, True), (10**15, 0, False), (10**15, 1, True), (2**62 // 100, 1, False)],
)
def test_times_of_ser_are_used_if_they_are_after_1970_and_increase(tmp_path, first, step, used):
    ticks = write.TICKS_1970 + first + step * np.arange(6)
    recording = lb.read_recording(write.ser(tmp_path / "a.ser", FRAMES, ticks=ticks))
    assert (recording.times is not None) == used
    if used:
        np.testing.assert_allclose(recording.times.seconds, step * np.arange(6) * 1e-7, rtol=1e-9)
        since = (recording.times.start - np.datetime64(0, "ns")) / np.timedelta64(1, "ns")
        assert since == 100.0 * first


def test_a_trailer_of_ser_that_is_not_whole_is_no_times(tmp_path):
    path = write.ser(tmp_path / "a.ser", FRAMES, ticks=write.TICKS_1970 + 10**15 + np.arange(6))
    assert lb.read_recording(path).times is not None
    path.write_bytes(path.read_bytes()[:-1])
    assert lb.read_recording(path).times is None


# Images


@pytest.mark.parametrize("depth", [1, 2, 4, 8])
def test_png_of_few_bits_keeps_its_numbers(tmp_path, depth):
    from PIL import Image

    values = np.arange(16, dtype=np.uint8).reshape(2, 8) & (2**depth - 1)
    Image.fromarray(values).save(tmp_path / "a.png", bits=depth)
    assert read(tmp_path / "a.png").shape == (1, 2, 8)
    np.testing.assert_array_equal(read(tmp_path / "a.png")[0], values)


def test_the_end_of_a_jpeg_may_be_followed_by_a_little(tmp_path):
    folder = write.images(tmp_path / "a", [np.full((64, 64), 90, np.uint8)], ".jpg")
    path = folder / "frame-0.jpg"
    whole = path.read_bytes()
    path.write_bytes(whole + bytes(1022))
    assert (read(path) == 90).all()
    path.write_bytes(whole + bytes(1023))
    with pytest.raises(lb.UnreadableFrame, match="not an image, or cut short"):
        lb.open_frames(path)


@pytest.mark.parametrize("at", ["first byte of a chunk", "checksum", "end"])
def test_a_png_is_whole_only_if_each_chunk_is(tmp_path, at):
    folder = write.images(tmp_path / "a", [FRAMES[0]], ".png")
    path = folder / "frame-0.png"
    whole = bytearray(path.read_bytes())
    if at == "end":
        whole = whole[:-12]
    else:
        whole[16 if at.startswith("first") else 32] ^= 1
    path.write_bytes(whole)
    with pytest.raises(lb.UnreadableFrame, match=r"frame-0.png cannot be read"):
        lb.open_frames(path)


# Folders and names


def test_what_does_not_belong_is_named_up_to_three():
    files = [Path(f"frame-{k}.png") for k in range(60)]
    for n in (1, 2, 3, 4, 5):
        strangers = [Path(f"{name}.png") for name in ("flat", "dark", "bias", "sky", "dome")[:n]]
        kept, (note,) = belonging(files + strangers)
        assert kept == files
        named = ", ".join(p.name for p in strangers[:3])
        more = f" and {n - 3} more" if n > 3 else ""
        assert note.endswith(f"left out: {named}{more}.")
        assert note.startswith(f"{n} of {60 + n} files do" + ("es not" if n == 1 else " not"))


@pytest.mark.parametrize(
    ("numbers", "said"),
    [
        ([1, 2, 3, 4], ""),
        ([1, 2, 3, 5], "from f3-7.png to f5-7.png:"),
        ([2, 4, 6, 10, 12], "from f6-7.png to f10-7.png:"),
        ([1, 2, 4, 5, 6, 9], "from f2-7.png to f4-7.png, the first of 2 jumps:"),
        ([1, 1, 2, 4], ""),
        ([10, 12, 15, 17], ""),
        ([1, 2, 4, 6], ""),
        ([1, 2, 3, 5, 7, 9], ""),
        ([1, 2, 3, 4, 6, 8], "from f4-7.png to f6-7.png, the first of 2 jumps:"),
    ],
)
def test_a_jump_in_names_is_more_than_the_step_of_most(numbers, said):
    found = jump_in_names([Path(f"f{n}-7.png") for n in numbers])
    assert (said in found[0]) if said else found == ()


def test_two_numbers_that_both_count_are_no_jump():
    assert jump_in_names([Path(f"{k}-{3 * k % 7}.png") for k in (1, 2, 5)]) == ()
    assert jump_in_names([Path("a1.png"), Path("a2.png"), Path("a5-1.png")]) == ()


def test_times_of_names_are_local_by_their_offset_and_zone():
    names = ["a_20260301-120000.250.png", "a_20260301-120001.500.png"]
    for offset, hour in ((None, 12), (2.0, 10), (-5.5, 17), ("Europe/Berlin", 11)):
        times = times_in_names(names, "%Y%m%d-%H%M%S.%f", offset)
        np.testing.assert_allclose(times.seconds, [0.0, 1.25], atol=1e-12)
        minutes = 30 if offset == -5.5 else 0
        assert times.start == np.datetime64(f"2026-03-01T{hour}:{minutes:02d}:00.250")
    with pytest.raises(ValueError, match="name_times must be a pattern"):
        times_in_names(names, "no directive")


# FITS


def test_times_of_a_cube_are_those_of_its_third_axis(tmp_path):
    """FITS standard 8.2: CRVAL + CDELT (pixel - CRPIX), pixels counted from one."""
    hdu = fits.PrimaryHDU(FRAMES)
    hdu.header.update(CTYPE3="TIME", CUNIT3="s", CRPIX3=2.0, CRVAL3=50.0, CDELT3=0.25)
    hdu.writeto(tmp_path / "a.fits")
    times = lb.read_recording(tmp_path / "a.fits").times
    from_first = times.seconds - times.seconds[0]
    np.testing.assert_allclose(from_first, 0.25 * np.arange(6), atol=1e-12)
    assert times.seconds[1] in (50.0, 0.25)
    for key, value in (("CTYPE3", "WAVE"), ("CUNIT3", "min")):
        hdu.header[key] = value
        hdu.writeto(tmp_path / "b.fits", overwrite=True)
        assert lb.read_recording(tmp_path / "b.fits").times is None


@pytest.mark.parametrize(
    ("stored", "bzero", "blank", "full"),
    [
        ("i2", 0, None, 32767),
        ("i2", 0, 0, 32767),
        ("u2", 32768, None, 65535),
        ("u2", 32768, 0, 65535),
        ("u1", 0, 0, 255),
        ("i4", 0, 0, 2**31 - 1),
        ("f4", 0, None, None),
        ("i2", 100, 0, None),
        ("i2", 100, None, None),
    ],
)
def test_undefined_pixels_leave_the_full_scale_of_the_integers(
    tmp_path, stored, bzero, blank, full
):
    data = (FRAMES % 200 + 1).astype(stored)
    hdu = fits.PrimaryHDU(data)
    if blank is not None:
        hdu.header["BLANK"] = blank if stored != "u2" else -32768
    if bzero == 100:
        hdu.scale("int16", bzero=100)
    hdu.writeto(tmp_path / "a.fits")
    assert fits.getheader(tmp_path / "a.fits").get("BZERO", 0) == bzero
    assert lb.open_frames(tmp_path / "a.fits").full_scale_dn == full


# Files kept open


def test_a_file_that_changes_is_read_anew(tmp_path):
    path = tmp_path / "a.npy"
    for k in range(4):
        np.save(path, FRAMES + k)
        np.testing.assert_array_equal(read(path), FRAMES + k)


@pytest.mark.parametrize(("suffix", "pack"), [(".gz", gzip.compress), (".bz2", bz2.compress)])
def test_a_packed_file_may_unpack_to_what_no_camera_packs(tmp_path, suffix, pack):
    """A megabyte of zeros in a few bytes is small; a hundred are not believed."""
    blank = np.zeros((1, 512, 1024), np.uint16)
    fits.PrimaryHDU(blank).writeto(tmp_path / "a.fits")
    path = tmp_path / f"a.fits{suffix}"
    path.write_bytes(pack((tmp_path / "a.fits").read_bytes()))
    assert not read(path).any()
