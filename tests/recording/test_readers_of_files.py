"""Each format's own traps: what its readers elsewhere are known to get wrong, by the numbers that were written."""

import gzip
import io
import struct

import cv2
import files_of_frames as write
import numpy as np
import pytest

import losbench as lb
from losbench.imaging.results import SpotFlag

fits = pytest.importorskip("astropy.io.fits")
FRAMES = np.random.default_rng(7).integers(0, 4000, (6, 20, 30)).astype(np.uint16)


def read(path, **options):
    frames = lb.open_frames(path, **options)
    return frames.read(0, frames.n_frames)


# TIFF: pages, one page for all, packed bits, white as zero, alpha (opencv#21700, suite2p#135, imread#19)


@pytest.mark.parametrize("bits", [10, 12, 14])
def test_packed_tiff_has_the_numbers_of_the_file(tmp_path, bits):
    tifffile, imagecodecs = pytest.importorskip("tifffile"), pytest.importorskip("imagecodecs")
    frame = np.random.default_rng(bits).integers(0, 2**bits, (7, 13)).astype(np.uint16)
    rows = [imagecodecs.packints_encode(row, bits) for row in frame]
    path = write.tiff(tmp_path / "a.tif", [(b"".join(rows), 7, 13)], bits=bits)
    frames = lb.open_frames(path)
    np.testing.assert_array_equal(frames.read(0, 1)[0], frame)
    np.testing.assert_array_equal(tifffile.imread(path), frame)
    assert frames.full_scale_dn == 2**bits - 1


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("described", ["ImageJ=1.54f\nimages=6\nframes=6\nloop=false\n", None])
def test_a_stack_in_one_page_is_frames(tmp_path, order, described):
    data = FRAMES.astype(f"{order}u2").tobytes()
    tags = {} if described else {32997: 6}  # ImageDepth
    path = tmp_path / "one.tif"
    write.tiff(path, [(data, 20, 30)], order=order, tags=tags)
    if described:
        whole = bytearray(path.read_bytes())
        at = len(whole)
        whole += described.encode() + b"\0"
        # One entry more: the description, between 262 and 273.
        directory = struct.unpack(order + "I", whole[4:8])[0]
        n = struct.unpack(order + "H", whole[directory : directory + 2])[0]
        entries = [bytes(whole[directory + 2 + 12 * k : directory + 14 + 12 * k]) for k in range(n)]
        entries.append(struct.pack(order + "HHII", 270, 2, len(described) + 1, at))
        entries.sort(key=lambda entry: struct.unpack(order + "H", entry[:2])[0])
        whole[4:8] = struct.pack(order + "I", len(whole))
        whole += struct.pack(order + "H", n + 1) + b"".join(entries) + bytes(4)
        path.write_bytes(bytes(whole))
    np.testing.assert_array_equal(read(path), FRAMES)
    path.write_bytes(path.read_bytes().replace(b"images=6\nframes=6", b"images=9\nframes=9"))
    if described:
        with pytest.raises(lb.UnreadableFrame, match=r"one.tif is cut short after frame 6 of 9"):
            lb.open_frames(path)


def test_white_as_zero_is_turned_and_said(tmp_path):
    frames = lb.open_frames(write.tiff16(tmp_path / "a.tif", 65535 - FRAMES, photometric=0))
    np.testing.assert_array_equal(frames.read(0, 6), FRAMES)
    assert frames.notes == ("In a.tif zero is white: its numbers are turned.",)


def test_a_page_that_turns_black_and_white_is_refused(tmp_path):
    path = write.tiff16(tmp_path / "a.tif", FRAMES)
    whole, entry = path.read_bytes(), struct.pack("<HHII", 262, 4, 1, 1)
    at = whole.rindex(entry)
    path.write_bytes(whole[:at] + struct.pack("<HHII", 262, 4, 1, 0) + whole[at + 12 :])
    with pytest.raises(lb.UnreadableFrame, match=r"page 5 of a.tif turns black and white"):
        read(path)


def test_a_page_that_does_not_say_what_zero_is_is_refused(tmp_path):
    path = write.tiff16(tmp_path / "a.tif", FRAMES)
    entry = struct.pack("<HHII", 262, 4, 1, 1)
    whole = path.read_bytes()
    at = whole.rindex(entry)
    path.write_bytes(whole[:at] + struct.pack("<HHII", 261, 4, 1, 1) + whole[at + 12 :])
    frames = lb.open_frames(path)
    with pytest.raises(
        lb.UnreadableFrame, match=r"page 5 of a.tif cannot be read: it does not say"
    ):
        frames.read(0, 6)


@pytest.mark.parametrize("alpha", [0, 65535])
def test_a_constant_alpha_is_dropped_and_another_refused(tmp_path, alpha):
    both = np.stack([FRAMES, np.full_like(FRAMES, alpha)], axis=-1)
    tags = {338: 2, 258: (16, 16)}
    pages = [(page.tobytes(), 20, 30) for page in both]
    frames = lb.open_frames(write.tiff(tmp_path / "a.tif", pages, samples=2, tags=tags))
    assert frames.dtype == np.uint16
    np.testing.assert_array_equal(frames.read(0, 6), FRAMES)
    both[0, 3, 4, 1] = 7
    pages = [(page.tobytes(), 20, 30) for page in both]
    path = write.tiff(tmp_path / "b.tif", pages, samples=2, tags=tags)
    with pytest.raises(lb.UnreadableFrame, match="transparency that is not the same everywhere"):
        lb.open_frames(path)


@pytest.mark.parametrize(
    "compression", ["zlib", "packbits", "lzma", "zstd", "lzw", "png", "jpegxl"]
)
@pytest.mark.parametrize("tiled", [False, True])
def test_compressed_pages_are_exact(tmp_path, compression, tiled):
    tifffile = pytest.importorskip("tifffile")
    pytest.importorskip("imagecodecs")
    tile = {"tile": (16, 16)} if tiled else {}
    options = {"compressionargs": {"lossless": True}} if compression == "jpegxl" else {}
    predictor = {"predictor": True} if compression in ("zlib", "lzw") else {}
    with tifffile.TiffWriter(tmp_path / "a.tif") as file:
        for frame in FRAMES:
            file.write(frame, compression=compression, contiguous=False, photometric="minisblack",
                       **tile, **options, **predictor)  # fmt: skip
    np.testing.assert_array_equal(read(tmp_path / "a.tif"), FRAMES)


def test_smaller_copies_are_no_pages(tmp_path):
    path = tmp_path / "a.tif"
    pages = [(FRAMES[0].tobytes(), 20, 30), (FRAMES[1, :10, :15].tobytes(), 10, 15)]
    write.tiff(path, pages, tags={254: 1})  # both say so: then there is nothing else to take
    with pytest.raises(lb.UnreadableFrame, match=r"all frames must be 20x30 uint16 as page 0"):
        read(path)
    whole = path.read_bytes()
    at = whole.index(struct.pack("<HHII", 254, 4, 1, 1))
    path.write_bytes(whole[:at] + struct.pack("<HHII", 254, 4, 1, 0) + whole[at + 12 :])
    frames = lb.open_frames(path)
    np.testing.assert_array_equal(frames.read(0, frames.n_frames), FRAMES[:1])
    assert frames.notes == ("a.tif holds 1 smaller copies of pages: they are left out.",)


@pytest.mark.parametrize("photometric", [3, 4, 5, 8])
def test_what_is_no_count_of_light_is_refused(tmp_path, photometric):
    path = write.tiff16(tmp_path / "a.tif", FRAMES, photometric=photometric)
    with pytest.raises(lb.UnreadableFrame, match="must be one grey image"):
        lb.open_frames(path)


@pytest.mark.parametrize("kind", ["order", "strips", "tiles", "fill order"])
def test_packed_bits_are_right_however_they_lie(tmp_path, kind):
    """12 bits in big-endian files, in strips, in tiles (imagecodecs), with the bits of bytes turned."""
    tifffile = pytest.importorskip("tifffile")
    pytest.importorskip("imagecodecs")
    frame = np.random.default_rng(12).integers(0, 4096, (48, 64)).astype(np.uint16)
    if kind == "fill order":
        data = write.tiff12(tmp_path / "b.tif", [frame]).read_bytes()[8 : 8 + 48 * 96]
        turned = np.packbits(
            np.unpackbits(np.frombuffer(data, np.uint8)), bitorder="little"
        ).tobytes()
        write.tiff(tmp_path / "a.tif", [(turned, 48, 64)], bits=12, tags={266: 2})
    else:
        from imagecodecs import packints_encode

        rows = b"".join(packints_encode(row, 12) for row in frame)
        order = ">" if kind == "order" else "<"
        if kind == "tiles":
            tiles = [frame[r : r + 16, c : c + 16] for r in (0, 16, 32) for c in range(0, 64, 16)]
            rows = b"".join(packints_encode(row, 12) for tile in tiles for row in tile)
        path = write.tiff(tmp_path / "a.tif", [(rows, 48, 64)], bits=12, order=order)
        if kind in ("strips", "tiles"):
            with tifffile.TiffFile(path) as file:
                begin = file.pages[0].dataoffsets[0]
            whole = bytearray(path.read_bytes())
            n = 12 if kind == "tiles" else 3
            each = len(rows) // n
            lists = len(whole)
            whole += struct.pack(f"<{n}I", *(begin + each * k for k in range(n)))
            whole += struct.pack(f"<{n}I", *([each] * n))
            tags = {256: (1, 64), 257: (1, 48), 258: (1, 12), 259: (1, 1), 262: (1, 1), 277: (1, 1)}
            tags |= (
                {322: (1, 16), 323: (1, 16), 324: (n, lists), 325: (n, lists + 4 * n)}
                if kind == "tiles"
                else {273: (n, lists), 278: (1, 16), 279: (n, lists + 4 * n)}
            )
            whole[4:8] = struct.pack("<I", len(whole))
            whole += struct.pack("<H", len(tags))
            whole += b"".join(struct.pack("<HHII", tag, 4, *v) for tag, v in sorted(tags.items()))
            path.write_bytes(bytes(whole) + bytes(4))
    np.testing.assert_array_equal(read(tmp_path / "a.tif")[0], frame)


def test_late_pages_do_not_walk_from_the_start(tmp_path, monkeypatch):
    """Reading the last page looks at no other directory."""
    tifffile = pytest.importorskip("tifffile")
    path = write.tiff16(tmp_path / "a.tif", np.repeat(FRAMES, 50, axis=0))
    frames = lb.open_frames(path)
    made = []
    once = tifffile.TiffPage.__init__
    monkeypatch.setattr(
        tifffile.TiffPage, "__init__", lambda self, *a, **k: made.append(1) or once(self, *a, **k)
    )
    np.testing.assert_array_equal(frames.read(299, 300)[0], FRAMES[-1])
    assert len(made) <= 2  # this page, and the first where the file is opened anew


def test_a_folder_of_stacks_is_one_recording_and_a_second_page_is_never_dropped(tmp_path):
    for k in range(2):
        write.tiff16(tmp_path / f"part-{k}.tif", FRAMES[3 * k : 3 * k + 3])
    np.testing.assert_array_equal(read(tmp_path), FRAMES)
    write.tiff16(tmp_path / "part-0.tif", FRAMES[:1])
    with pytest.raises(
        lb.UnreadableFrame, match=r"part-1.tif must be one image as the first file, but has 3"
    ):
        read(tmp_path)


# Images


@pytest.mark.parametrize("suffix", [".png", ".bmp", ".pgm", ".jpg", ".tif"])
def test_every_image_comes_back_and_a_cut_one_is_named(tmp_path, suffix):
    smooth = (np.add.outer(np.arange(20), np.arange(30)) * 4).astype(np.uint8)
    folder = write.images(tmp_path / "frames", [smooth, smooth + 9], suffix)
    stack = read(folder)
    assert stack.dtype == np.uint8
    assert np.abs(stack[0].astype(int) - smooth).max() <= (4 if suffix == ".jpg" else 0)
    whole = (folder / f"frame-1{suffix}").read_bytes()
    for length in (len(whole) * 3 // 4, len(whole) - 13):
        (folder / f"frame-1{suffix}").write_bytes(whole[:length])
        recording = lb.read_recording(folder, on_unreadable="skip")
        block = recording.stamps[0].read(0, 2, skip=True)
        assert block.good.tolist() == [True, False], (suffix, length)
        assert f"frame-1{suffix}" in block.skipped[1]


@pytest.mark.parametrize("suffix", [".png", ".jpg", ".tif"])
def test_colour_that_is_grey_is_grey_and_other_colour_needs_a_channel(tmp_path, suffix):
    smooth = (np.add.outer(np.arange(20), np.arange(30)) * 4).astype(np.uint8)
    grey = np.repeat(smooth[..., None], 3, axis=-1)
    frames = lb.open_frames(write.images(tmp_path / "grey", [grey] * 3, suffix))
    assert np.abs(frames.read(0, 1)[0].astype(int) - smooth).max() <= (4 if suffix == ".jpg" else 0)
    assert frames.notes == ("The 3 channels of grey show one grey image: it is measured.",)
    colour = np.stack([smooth // 4, smooth // 2, smooth], axis=-1)  # blue, green, red
    folder = write.images(tmp_path / "colour", [colour] * 3, suffix)
    with pytest.raises(
        lb.UnreadableFrame,
        match=rf"frame-0\{suffix} must be one grey image .*got 3 colour channels .*--channel",
    ):
        lb.open_frames(folder)
    if suffix != ".jpg":
        for name, divisor in (("red", 1), ("green", 2), (2, 4)):
            red = lb.open_frames(folder, channel=name)
            np.testing.assert_array_equal(red.read(2, 3)[0], smooth // divisor)
        assert "the one called red" in lb.open_frames(folder, channel="red").notes[0]
    with pytest.raises(
        ValueError, match="channel must be 'red', 'green' or 'blue', or a number below"
    ):
        lb.open_frames(folder, channel="mauve")


def test_sixteen_bit_colour_keeps_its_bits(tmp_path):
    colour = np.stack([FRAMES[0] * 2, FRAMES[0] + 256, FRAMES[0]], axis=-1)
    folder = write.images(tmp_path / "c", [colour] * 2, ".png")
    np.testing.assert_array_equal(lb.open_frames(folder, channel="red").read(0, 1)[0], FRAMES[0])


def test_a_later_frame_in_colour_is_not_taken_for_grey(tmp_path):
    grey = np.repeat(FRAMES[0, ..., None], 3, axis=-1)
    folder = write.images(
        tmp_path / "c", [grey, grey, grey * np.array([1, 2, 3], np.uint16)], ".png"
    )
    with pytest.raises(lb.UnreadableFrame, match=r"frame-2.png must be one grey image"):
        read(folder)


def png_header(rows, columns):
    import zlib

    def chunk(name, data):
        return (
            struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))
        )

    head = struct.pack(">IIBBBBB", columns, rows, 16, 0, 0, 0, 0)
    return (
        b"\x89PNG\r\n\x1a\n"
        + chunk(b"IHDR", head)
        + chunk(b"IDAT", zlib.compress(b"0" * 99))
        + chunk(b"IEND", b"")
    )


def test_a_header_that_claims_gigabytes_is_refused_before_memory_is_asked_for(tmp_path):
    (tmp_path / "a.png").write_bytes(png_header(32_000, 32_000))
    with pytest.raises(
        lb.UnreadableFrame, match=r"a.png cannot be read: its header claims more than"
    ):
        lb.open_frames(tmp_path / "a.png")
    # A chunk of four gigabytes, for which OpenCV would ask for memory.
    write.images(tmp_path / "f", FRAMES[:1], ".png")
    whole = bytearray((tmp_path / "f" / "frame-0.png").read_bytes())
    whole[33:37] = b"\xff\xff\xff\xff"
    (tmp_path / "b.png").write_bytes(whole)
    with pytest.raises(
        lb.UnreadableFrame, match=r"b.png cannot be read: not an image, or cut short"
    ):
        lb.open_frames(tmp_path / "b.png")
    (tmp_path / "a.pgm").write_bytes(b"P5 40000 40000 255\n123")
    with pytest.raises(lb.UnreadableFrame, match=r"a.pgm cannot be read: its header claims"):
        lb.open_frames(tmp_path / "a.pgm")
    write.tiff(tmp_path / "a.tif", [(b"12", 40_000, 40_000)])
    with pytest.raises(
        lb.UnreadableFrame, match=r"page 0 of a.tif cannot be read: its header claims"
    ):
        lb.open_frames(tmp_path / "a.tif")


@pytest.mark.parametrize("depth", [2, 4])
def test_numbers_of_few_bits_are_not_stretched(tmp_path, depth):
    import zlib

    def chunk(name, data):
        return (
            struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))
        )

    values = np.arange(8, dtype=np.uint8) % 2**depth
    packed = np.packbits(np.unpackbits(values[:, None], axis=1)[:, 8 - depth :].ravel()).tobytes()
    head = struct.pack(">IIBBBBB", 8, 1, depth, 0, 0, 0, 0)
    body = (
        chunk(b"IHDR", head) + chunk(b"IDAT", zlib.compress(b"\0" + packed)) + chunk(b"IEND", b"")
    )
    (tmp_path / "a.png").write_bytes(b"\x89PNG\r\n\x1a\n" + body)
    assert read(tmp_path / "a.png").ravel().tolist() == values.tolist()
    for top in (15, 4095):
        wide = ">u2" if top > 255 else "u1"
        (tmp_path / "a.pgm").write_bytes(
            f"P5 3 1 {top}\n".encode() + np.array([0, 7, top], wide).tobytes()
        )
        assert read(tmp_path / "a.pgm").ravel().tolist() == [0, 7, top]
        (tmp_path / "b.pgm").write_text(f"P2\n# a comment\n3 1\n{top}\n0 7 {top}\n")
        if top == 15:
            (tmp_path / "c.pgm").write_text((tmp_path / "b.pgm").read_text())
        else:
            assert read(tmp_path / "b.pgm").ravel().tolist() == [0, 7, top]
    with pytest.raises(
        lb.UnreadableFrame, match=r"c.pgm cannot be read: a PGM in text must have 8 or 16"
    ):
        read(tmp_path / "c.pgm")


# NumPy


@pytest.mark.parametrize("dtype", ["<u2", ">u2", "<i2", ">i4", ">f4", "<f8", "u1", "i1"])
def test_numbers_of_any_type_and_order_come_back(tmp_path, dtype):
    frames = (FRAMES % 100).astype(dtype)
    np.save(tmp_path / "a.npy", frames)
    np.savez_compressed(tmp_path / "a.npz", frames)
    for name in ("a.npy", "a.npz"):
        stack = read(tmp_path / name)
        assert stack.dtype.isnative and stack.dtype in (np.uint8, np.uint16, np.float32)
        np.testing.assert_array_equal(stack, FRAMES % 100)


@pytest.mark.parametrize(
    ("dtype", "full"),
    [
        ("<u2", 65535),
        (">u2", 65535),
        ("<i2", 32767),
        (">i2", 32767),
        ("u1", 255),
        ("<u2", 4095),
        ("<u2", 65520),
    ],
)
def test_saturation_is_found_on_the_numbers_of_the_file(tmp_path, dtype, full):
    """Cameras end at 4095 or, left-aligned, at 65520, whatever type holds the numbers."""
    y, x = np.mgrid[:64, :64]
    noise = np.random.default_rng(3).normal(0, 3 * full / 4095, (3, 64, 64))
    light = full * 0.05 + full * 1.15 * np.exp(-((x - 31.4) ** 2 + (y - 30.3) ** 2) / 4.5) + noise
    step = 16 if full == 65520 else 1
    frames = (np.clip(np.round(light / step) * step, 0, full)).astype(dtype)
    np.save(tmp_path / "a.npy", frames)
    recording = lb.read_recording(tmp_path / "a.npy")
    assert 2 <= (frames[0] == full).sum() <= 6
    assert recording.full_scale_dn == full / step
    flags = lb.measure(recording, spots=[[31, 30]]).flags
    assert (flags & SpotFlag.SATURATED > 0).all()


def test_two_stacks_of_an_archive_are_not_chosen_from(tmp_path):
    np.savez(tmp_path / "a.npz", light=FRAMES, dark=FRAMES[:2])
    with pytest.raises(
        ValueError, match=r"a.npz must hold one stack .*got light \(6, 20, 30\), dark \(2, 20, 30\)"
    ):
        lb.open_frames(tmp_path / "a.npz")
    np.savez(tmp_path / "b.npz", frames=FRAMES, dark=FRAMES[:2], times=np.arange(6))
    np.testing.assert_array_equal(read(tmp_path / "b.npz"), FRAMES)
    assert "Not read of b.npz: dark, times." in lb.open_frames(tmp_path / "b.npz").notes


@pytest.mark.parametrize("save", [np.savez, np.savez_compressed])
@pytest.mark.parametrize("name", ["mask", "DQ", "bad_pixels"])
def test_a_mask_beside_frames_marks_bad_pixels(tmp_path, save, name):
    mask = np.zeros((20, 30), dtype=np.uint8)
    mask[3, 4] = 5
    save(tmp_path / "a.npz", **{"frames": FRAMES, name: mask})
    frames = lb.open_frames(tmp_path / "a.npz")
    np.testing.assert_array_equal(frames.bad, mask > 0)
    assert frames.notes == (f"Pixels marked by {name} of a.npz are left out.",)
    save(tmp_path / "b.npz", **{"frames": FRAMES, name: mask.astype(float)})
    np.testing.assert_array_equal(lb.open_frames(tmp_path / "b.npz").bad, mask > 0)
    np.testing.assert_array_equal(frames.read(0, 6), FRAMES)


def test_masks_of_each_frame_and_of_all_are_holes_in_them(tmp_path):
    each, of_all = np.zeros(FRAMES.shape, dtype=bool), np.zeros((20, 30), dtype=bool)
    each[2, 5, 6], of_all[3, 4] = True, True
    for frames in (FRAMES, np.asfortranarray(FRAMES)):
        np.savez(tmp_path / "a.npz", frames, mask=each, flags=of_all)
        found = read(tmp_path / "a.npz")
        np.testing.assert_array_equal(np.isnan(found), each | of_all)
        np.testing.assert_array_equal(found[~np.isnan(found)], FRAMES[~(each | of_all)])


def test_what_is_no_mask_by_its_size_kind_or_name_is_said_not_to_be_read(tmp_path):
    others = {"mask": np.ones((30, 20)), "masked": np.ones((20, 30)), "flags": FRAMES}
    np.savez(tmp_path / "a.npz", frames=FRAMES, **others)
    frames = lb.open_frames(tmp_path / "a.npz")
    assert frames.bad is None and frames.notes == ("Not read of a.npz: flags, mask, masked.",)
    np.savez(tmp_path / "b.npz", mask=FRAMES)
    np.testing.assert_array_equal(read(tmp_path / "b.npz"), FRAMES)


def test_a_mask_of_nan_is_refused(tmp_path):
    np.savez(tmp_path / "a.npz", frames=FRAMES, mask=np.full((20, 30), np.nan))
    with pytest.raises(lb.UnreadableFrame, match=r"^a.npz cannot be read: .*, got NaN$|^a mask"):
        lb.open_frames(tmp_path / "a.npz")


@pytest.mark.parametrize("save", [np.savez, np.savez_compressed])
def test_a_changed_byte_of_an_archive_is_found(tmp_path, save):
    save(tmp_path / "a.npz", frames=FRAMES)
    whole = bytearray((tmp_path / "a.npz").read_bytes())
    whole[len(whole) // 2] ^= 4
    (tmp_path / "a.npz").write_bytes(bytes(whole))
    with pytest.raises(lb.UnreadableFrame, match=r"a.npz cannot be read"):
        lb.open_frames(tmp_path / "a.npz")


def test_headers_of_stacks_that_lie_are_refused_in_one_line(tmp_path):
    for shape in ("(-1, 32, 56)", "(6, 20, 30000000)", "(6, 20, 30", "'nonsense'"):
        head = f"{{'descr': '<u2', 'fortran_order': False, 'shape': {shape}, }}".ljust(117) + "\n"
        (tmp_path / "a.npy").write_bytes(b"\x93NUMPY\x01\x00v\x00" + head.encode() + bytes(7200))
        with pytest.raises(lb.UnreadableFrame, match=r"^a\.npy [^\n]*$"):
            lb.open_frames(tmp_path / "a.npy")
    np.save(tmp_path / "o.npy", np.array([[[{}]]]), allow_pickle=True)
    with pytest.raises(lb.UnreadableFrame, match=r"o.npy must hold numbers, got object"):
        lb.open_frames(tmp_path / "o.npy")


def test_masked_pixels_of_an_array_are_nan():
    masked = np.ma.array(FRAMES, mask=FRAMES > 3900)
    frames = lb.open_frames(masked).read(0, 6)
    np.testing.assert_array_equal(np.isnan(frames), FRAMES > 3900)


# Left-aligned numbers


@pytest.mark.parametrize(
    ("codes", "step"),
    [
        (lambda v: v << 4, 16),
        (lambda v: (v >> 2) << 6, 64),
        (lambda v: (v << 4) + 7, 16),
        (lambda v: v, 1),
        (lambda v: v << 4 | v >> 8, 1),
        (lambda v: np.rint(v * 65535 / 4095), 1),
    ],
)
def test_the_step_of_left_aligned_numbers_is_found_and_divided_out(codes, step):
    values = np.random.default_rng(2).integers(100, 900, (3, 60, 80))
    frames = codes(values).astype(np.uint16)
    frames[0, :3, 0] = 4001, 3001, 2001  # bad pixels
    found = lb.open_frames(frames)
    assert found.step == step
    np.testing.assert_array_equal(found.read(1, 3), frames[1:] // step)
    assert any("left-aligned" in note for note in found.notes) == (step > 1)


def test_a_dark_of_left_aligned_frames_has_their_step_even_where_it_does_not_show():
    values = np.random.default_rng(2).integers(100, 900, (3, 60, 80)).astype(np.uint16)
    dark = np.full((2, 60, 80), 20 << 4, np.uint16)
    frames = lb.read_recording(values << 4, dark=dark).stamps[0]
    np.testing.assert_array_equal(frames.load(1), values[1] - 20.0)


# FITS


@pytest.mark.parametrize("bzero", [0, 32768])
@pytest.mark.parametrize("packed", [False, True])
def test_undefined_pixels_are_nan_before_scaling(tmp_path, bzero, packed):
    """FITS standard 4.4.2.5: BLANK is compared with the stored integers."""
    stored = (FRAMES.astype(int) - bzero).astype(">i2")
    stored[:, 3, 4] = 32767
    header = fits.Header()
    for key, value in (
        ("SIMPLE", True),
        ("BITPIX", 16),
        ("NAXIS", 3),
        ("NAXIS1", 30),
        ("NAXIS2", 20),
        ("NAXIS3", 6),
        ("BZERO", bzero),
        ("BSCALE", 1),
        ("BLANK", 32767),
    ):
        header[key] = value
    data = stored.tobytes()
    whole = header.tostring().encode() + data + bytes(-len(data) % 2880)
    path = tmp_path / ("a.fits.gz" if packed else "a.fits")
    path.write_bytes(gzip.compress(whole) if packed else whole)
    stack = read(path)
    assert np.isnan(stack[:, 3, 4]).all() and np.isnan(stack).sum() == 6
    np.testing.assert_array_equal(stack[:, 5:], FRAMES[:, 5:])


@pytest.mark.parametrize(
    "how",
    [
        {"dtype": "f4"},
        {"dtype": "f4", "compressed": True},
        {"dtype": "i4", "bscale": 0.5, "bzero": 3.0},
        {"dtype": "i2", "compressed": True},
        {"dtype": "u1"},
    ],
)
def test_scaled_and_compressed_images_are_as_astropy_gives_them(tmp_path, how):
    data = (FRAMES[:1] % 200).astype(how["dtype"])
    if how.get("compressed"):
        options = {"quantize_level": 0} if how["dtype"] == "f4" else {}
        kind = {"compression_type": "GZIP_1" if how["dtype"] == "f4" else "RICE_1"}
        hdus = [fits.PrimaryHDU(), fits.CompImageHDU(data[0], **kind, **options)]
    else:
        hdus = [fits.PrimaryHDU(data)]
        if "bscale" in how:
            hdus[0].scale("int32", bscale=how["bscale"], bzero=how["bzero"])
    fits.HDUList(hdus).writeto(tmp_path / "a.fits")
    np.testing.assert_array_equal(
        read(tmp_path / "a.fits")[0], np.squeeze(fits.getdata(tmp_path / "a.fits"))
    )


def test_planes_of_uncertainty_are_no_frames_and_masks_are_kept(tmp_path):
    mask = (FRAMES[0] > 3500).astype(np.uint8)
    image = FRAMES[0].astype("f4")
    extensions = [
        fits.ImageHDU(image, name="SCI"),
        fits.ImageHDU(image * 0, name="ERR"),
        fits.ImageHDU(mask, name="DQ"),
    ]
    fits.HDUList([fits.PrimaryHDU(), *extensions]).writeto(tmp_path / "a.fits")
    recording = lb.read_recording(tmp_path / "a.fits")
    assert recording.n_frames == 1
    assert recording.notes == (
        "a.fits holds 1 masks, whose pixels are left out.",
        "a.fits holds 1 planes of uncertainty, which are no frames.",
    )
    np.testing.assert_array_equal(np.isnan(recording.stamps[0].load(0)), mask > 0)
    # One mask for each frame: bad only where it says so.
    pairs = []
    for k in range(3):
        pairs += [
            fits.ImageHDU(FRAMES[k], name="SCI"),
            fits.ImageHDU((FRAMES[k] > 3500).astype(np.uint8), name="DQ"),
        ]
    fits.HDUList([fits.PrimaryHDU(), *pairs]).writeto(tmp_path / "b.fits")
    np.testing.assert_array_equal(np.isnan(read(tmp_path / "b.fits")), FRAMES[:3] > 3500)


@pytest.mark.parametrize(
    "others",
    [
        ["ERR", "DQ", "AREA", "VAR_POISSON", "VAR_RNOISE"],
        ["ERR", "DQ", "SAMP", "TIME"],
        ["MASK", "VARIANCE"],
        ["preview"],
    ],
)
def test_of_named_extensions_only_the_image_is_a_frame(tmp_path, others):
    """JWST, HST, LSST, and whoever names one extension SCI."""
    name = "IMAGE" if "VARIANCE" in others else "SCI"
    extra = [fits.ImageHDU((FRAMES[1] * 0).astype("f4"), name=other) for other in others]
    fits.HDUList(
        [fits.PrimaryHDU(), fits.ImageHDU(FRAMES[0].astype("f4"), name=name), *extra]
    ).writeto(tmp_path / "a.fits")
    np.testing.assert_array_equal(read(tmp_path / "a.fits"), FRAMES[:1])


def test_cubes_of_one_folder_are_joined(tmp_path):
    for k in range(2):
        fits.PrimaryHDU(FRAMES[3 * k : 3 * k + 3]).writeto(tmp_path / f"{k}.fits")
    np.testing.assert_array_equal(read(tmp_path), FRAMES)


def test_ccddata_of_astropy_is_one_frame(tmp_path):
    from astropy.nddata import CCDData, StdDevUncertainty

    image = FRAMES[0].astype("f4")
    for k in range(2):
        data = CCDData(
            image + k,
            unit="adu",
            uncertainty=StdDevUncertainty(np.sqrt(image + 1)),
            mask=FRAMES[k] > 3900,
        )
        data.write(tmp_path / f"{k}.fits")
    assert lb.read_recording(tmp_path / "0.fits").n_frames == 1
    stack = read(tmp_path)
    assert len(stack) == 2
    np.testing.assert_array_equal(np.isnan(stack), FRAMES[:2] > 3900)


@pytest.mark.parametrize(
    ("clock", "utc"),
    [
        ("UTC", "2016-12-31T23:59:59"),
        ("TAI", "2016-12-31T23:59:23"),
        ("TT", "2016-12-31T23:58:50.816"),
        ("GPS", "2016-12-31T23:59:42"),
    ],
)
def test_the_clock_of_the_file_is_turned_into_utc(tmp_path, clock, utc):
    """36 leap seconds at the end of 2016 (IERS Bulletin C 51); TT is TAI + 32.184 s, GPS is TAI - 19 s."""
    for k in range(2):
        hdu = fits.PrimaryHDU(FRAMES[k])
        hdu.header.update(
            {
                "DATE-OBS": f"2016-12-31T23:59:{58 + k}"
                if clock == "UTC"
                else f"2016-12-31T23:59:{59 if k else 54}",
                "TIMESYS": clock,
            }
        )
        hdu.writeto(tmp_path / f"{k}.fits")
    times = lb.read_recording(tmp_path).times
    last = times.start + np.timedelta64(round(times.seconds[1] * 1e9), "ns")
    assert abs((last - np.datetime64(utc)) / np.timedelta64(1, "us")) <= 2
    with fits.open(tmp_path / "0.fits", mode="update") as hdus:
        hdus[0].header["TIMESYS"] = "LOCAL"
    with pytest.raises(ValueError, match="keep one TIMESYS"):
        lb.read_recording(tmp_path)


def test_a_dark_among_the_files_is_left_out_by_its_header(tmp_path):
    for k in range(4):
        hdu = fits.PrimaryHDU(FRAMES[k])
        hdu.header["IMAGETYP"] = "Dark Frame" if k == 1 else "Light Frame"
        hdu.writeto(tmp_path / f"{k}.fits")
    recording = lb.read_recording(tmp_path, period_s=1.0)
    assert recording.n_frames == 3 and "1.fits: a dark, bias or flat" in recording.notes[0]
    np.testing.assert_array_equal(recording.stamps[0].load(1), FRAMES[2])


def test_axes_of_one_say_nothing(tmp_path):
    for k in range(2):
        fits.PrimaryHDU(FRAMES[k][None, None]).writeto(tmp_path / f"{k}.fits")
    np.testing.assert_array_equal(read(tmp_path), FRAMES[:2])


@pytest.mark.parametrize("suffix", [".gz", ".bz2"])
def test_a_damaged_packed_file_is_named(tmp_path, suffix):
    import bz2

    whole = io.BytesIO()
    fits.PrimaryHDU(FRAMES).writeto(whole)
    packed = (gzip if suffix == ".gz" else bz2).compress(whole.getvalue())
    path = tmp_path / f"a.fits{suffix}"
    path.write_bytes(packed)
    np.testing.assert_array_equal(read(path), FRAMES)
    for at in range(200, len(packed) - 60, 397):
        path.write_bytes(packed[:at] + bytes(40) + packed[at + 40 :])
        with pytest.raises(lb.UnreadableFrame, match=rf"^a\.fits\{suffix} cannot be read: [^\n]*$"):
            lb.open_frames(path, on_unreadable="skip")


def test_a_cut_cube_is_named_or_ends_early(tmp_path):
    fits.PrimaryHDU(np.repeat(FRAMES, 4, axis=0)).writeto(tmp_path / "a.fits")
    (tmp_path / "a.fits").write_bytes((tmp_path / "a.fits").read_bytes()[: 2880 + 1200 * 9 + 7])
    with pytest.raises(lb.UnreadableFrame, match=r"a.fits is cut short after frame 9 of 24: skip"):
        lb.open_frames(tmp_path / "a.fits")
    kept = lb.open_frames(tmp_path / "a.fits", on_unreadable="skip")
    np.testing.assert_array_equal(kept.read(0, 9), np.repeat(FRAMES, 4, axis=0)[:9])


def pixel_file(path, *, quality=None, names=("TIME", "FLUX", "FLUX_ERR"), star=None, n=40):
    rng = np.random.default_rng(0)
    y, x = np.mgrid[:11, :11]
    flux = 5e3 * np.exp(-((x - 5.2) ** 2 + (y - 5.1) ** 2) / 2 / 1.3**2) + rng.normal(
        0, 5, (n, 11, 11)
    )
    columns = {
        "TIME": fits.Column("TIME", "D", array=1000 + np.arange(n) / 720),
        "FLUX": fits.Column("FLUX", "121E", dim="(11,11)", array=flux.astype("f4")),
        "FLUX_ERR": fits.Column(
            "FLUX_ERR", "121E", dim="(11,11)", array=np.full_like(flux, 5, "f4")
        ),
    }
    chosen = [columns[name] for name in names]
    if quality is not None:
        chosen.append(fits.Column("QUALITY", "J", array=quality))
    primary = fits.PrimaryHDU()
    if star:
        primary.header["OBJECT"] = star
    fits.HDUList([primary, fits.BinTableHDU.from_columns(chosen)]).writeto(path)
    return path


def test_cadences_that_quality_marks_are_left_out(tmp_path):
    quality = np.zeros(40, np.int32)
    quality[10:14] = 4 | 32
    recording = lb.read_recording(pixel_file(tmp_path / "a.fits", quality=quality))
    measured = lb.measure(recording)
    assert np.flatnonzero(np.isnan(measured.xy_px[:, 0, 0])).tolist() == [10, 11, 12, 13]
    assert (measured.flags[10:14, 0] & SpotFlag.MISSING > 0).all()
    assert (
        "4 of 40 frames have a QUALITY that is not zero: what it marks is left out."
        in measured.notes
    )


def test_stars_are_named_where_their_files_do(tmp_path):
    for k in range(3):
        pixel_file(tmp_path / f"{k}.fits", star=f"KIC {k}")
    recording = lb.read_recording(tmp_path)
    assert [stamp.frames.star for stamp in recording.stamps] == ["KIC 0", "KIC 1", "KIC 2"]
    assert recording.notes == ("Spot by spot, the stars are KIC 0, KIC 1, KIC 2.",)
    with pytest.raises(ValueError, match="path holds 3 stamps of a detector"):
        lb.open_frames(tmp_path)


def test_a_pixel_file_without_times_is_refused_by_name(tmp_path):
    path = pixel_file(tmp_path / "a.fits", names=("FLUX",))
    with pytest.raises(lb.UnreadableFrame, match=r"a.fits must have a column TIME, it has FLUX"):
        lb.read_recording(path)
    pixel_file(tmp_path / "b.fits")
    whole = (tmp_path / "b.fits").read_bytes()
    (tmp_path / "b.fits").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(
        lb.UnreadableFrame, match=r"b.fits cannot be read: cut short, its header claims"
    ):
        lb.read_recording(tmp_path / "b.fits")


@pytest.mark.parametrize("kind", ["cube", "folder", "pixels"])
def test_a_fits_file_without_a_key_is_refused_in_one_line_that_names_it(tmp_path, kind):
    path = tmp_path / "a.fits"
    pixel_file(path) if kind == "pixels" else fits.PrimaryHDU(
        FRAMES[0] if kind == "folder" else FRAMES
    ).writeto(path)
    if kind == "folder":
        fits.PrimaryHDU(FRAMES[1]).writeto(tmp_path / "b.fits")
    whole = path.read_bytes()
    said = []
    for key in (
        b"BITPIX",
        b"NAXIS ",
        b"NAXIS1",
        b"NAXIS2",
        b"TFIELDS",
        b"TFORM2",
        b"TTYPE2",
        b"PCOUNT",
    ):
        at = whole.rfind(key)
        if at < 0:
            continue
        path.write_bytes(whole[:at] + b"X\xfe?" + whole[at + 3 :])
        try:
            lb.read_recording(tmp_path if kind == "folder" else path).stamps[0].load(0)
        except ValueError as error:
            said.append(str(error))
    assert len(said) >= 3
    for line in said:  # and more than a bare key
        assert "a.fits" in line and "\n" not in line and not line.endswith("'")


def test_an_archive_packed_in_another_way_is_refused(tmp_path):
    np.savez_compressed(tmp_path / "a.npz", frames=FRAMES)
    whole = (tmp_path / "a.npz").read_bytes()
    at = whole.index(b"PK\x01\x02") + 10
    (tmp_path / "a.npz").write_bytes(whole[:at] + b"\x63\x00" + whole[at + 2 :])
    with pytest.raises(lb.UnreadableFrame, match=r"^a\.npz cannot be read: [^\n]+$"):
        lb.open_frames(tmp_path / "a.npz")


# SER, raw, HDF5, video


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("flag", [0, 1])
@pytest.mark.parametrize("depth", [8, 12, 16])
def test_ser_is_read_whatever_its_flag_says(tmp_path, order, flag, depth):
    """Writers disagree on the meaning of the header's flag, so the numbers themselves decide."""
    light = lb.render_spots([[15.0, 10.0]], 4e5 if depth == 16 else 2e4, 3.0, (20, 30)) + 100
    frames = (
        np.random.default_rng(1).poisson(np.repeat(light[None], 4, axis=0)).clip(0, 2**depth - 1)
    )
    frames = frames.astype(np.uint8 if depth == 8 else np.uint16)
    path = write.ser(tmp_path / "a.ser", frames, depth=depth, order=order, flag=flag)
    np.testing.assert_array_equal(read(path), frames)
    assert lb.open_frames(path).full_scale_dn == 2**depth - 1


def test_ser_has_the_utc_of_each_frame(tmp_path):
    begin = (
        write.TICKS_1970
        + int((np.datetime64("2026-03-01T12:00:00") - np.datetime64(0, "s")).astype(int)) * 10**7
    )
    path = write.ser(tmp_path / "a.ser", FRAMES, ticks=begin + np.arange(6) * 123_456)
    times = lb.read_recording(path).times
    assert times.start == np.datetime64("2026-03-01T12:00:00")
    np.testing.assert_allclose(times.seconds, np.arange(6) * 0.0123456, atol=1e-12)
    backwards = lb.read_recording(write.ser(tmp_path / "b.ser", FRAMES, ticks=begin - np.arange(6)))
    assert backwards.times is None and "do not increase" in backwards.notes[0]
    whole = path.read_bytes()
    path.write_bytes(whole[: 178 + 1200 * 4 + 5])
    with pytest.raises(lb.UnreadableFrame, match=r"a.ser is cut short after frame 4 of 6"):
        lb.read_recording(path)
    assert lb.read_recording(path, on_unreadable="skip").n_frames == 4


@pytest.mark.parametrize("pixels", ["mono10p", "mono12p", "mono14p", "mono12packed"])
def test_packed_raw_frames_run_on_over_the_ends_of_rows(tmp_path, pixels):
    bits = int(pixels[4:6])
    frames = np.random.default_rng(bits).integers(0, 2**bits, (3, 7, 10)).astype(np.uint16)
    path = write.raw(tmp_path / "a", frames, pixels, header_bytes=11, gap_bytes=2)
    np.testing.assert_array_equal(read(path), frames)
    cut = path.with_suffix(".raw")
    cut.write_bytes(cut.read_bytes()[:-5])
    with pytest.raises(lb.UnreadableFrame, match=r"a.raw is cut short after frame 2 of 3"):
        lb.open_frames(path)


def test_the_bytes_of_the_packed_formats_mean_what_the_standards_say(tmp_path):
    """0x12 0x34 0x56: GenICam PFNC 2.4 (12p: low bits first), GigE Vision 2.0 (12Packed: halves in the middle)."""
    for pixels, expected in (("mono12p", [1042, 1379]), ("mono12packed", [292, 1379])):
        (tmp_path / "a.raw").write_bytes(bytes([0x12, 0x34, 0x56]))
        (tmp_path / "a.toml").write_text(f'file = "a.raw"\npixels = "{pixels}"\nshape = [1, 2]\n')
        assert read(tmp_path / "a.toml").ravel().tolist() == expected
    (tmp_path / "a.raw").write_bytes(bytes([0x12, 0x34, 0x56, 0x78, 0x9A]))
    (tmp_path / "a.toml").write_text('file = "a.raw"\npixels = "mono10p"\nshape = [1, 4]\n')
    assert read(tmp_path / "a.toml").ravel().tolist() == [18, 397, 901, 617]


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        ('file = "a.raw"\npixels = "mono12"\nshape = [4, 5]', "describes a.raw, which is not beside it"),
        ('file = "here.raw"\npixels = "mono13"\nshape = [4, 5]', "a.toml: pixels must be one of 'mono8'"),
        ('file = "here.raw"\npixels = "mono12"\nshape = [4]', r"a.toml: shape must be \(rows, cols\)"),
        ('file = "here.raw"\npixels = "mono12"\nshape = [4, 0]', "a.toml: shape must be a whole number"),
        ('file = "here.raw"\npixel = "mono12"\nshape = [4, 5]', "a.toml: unknown key pixel; known are file, pixels"),
        ('focal_mm = 260', "a.toml: unknown key focal_mm"),
        ('file = ', "not a TOML file"),
    ],
)  # fmt: skip
def test_a_description_that_does_not_fit_is_refused_in_one_line(tmp_path, lines, message):
    (tmp_path / "here.raw").write_bytes(bytes(100))
    (tmp_path / "a.toml").write_text(lines)
    with pytest.raises((ValueError, FileNotFoundError), match=message):
        lb.read_recording(tmp_path / "a.toml")


def test_hdf5_stacks_are_chosen_by_name(tmp_path):
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["light/data"], file["dark"], file["flat"] = FRAMES, FRAMES[:2], FRAMES[0]
    with pytest.raises(
        ValueError,
        match=r"or dataset must name one \(--dataset\), got dark \(2, 20, 30\), light/data",
    ):
        lb.open_frames(tmp_path / "a.h5")
    np.testing.assert_array_equal(read(tmp_path / "a.h5", dataset="/light/data"), FRAMES)
    with pytest.raises(ValueError, match="dataset must be a stack .*got 'flat'"):
        lb.open_frames(tmp_path / "a.h5", dataset="flat")
    with h5py.File(tmp_path / "empty.h5", "w") as file:
        file.create_dataset("x", shape=(10**6, 4000, 4000), chunks=(1, 100, 100), dtype="u2")
    with pytest.raises(lb.UnreadableFrame, match=r"empty.h5 cannot be read: .*claims"):
        lb.open_frames(tmp_path / "empty.h5")


def test_a_chunk_of_no_bytes_is_found_before_hdf5_s_own_library_reads_it(tmp_path):
    """The library's checksum of such a chunk ends the process (found by fuzzing)."""
    h5py = pytest.importorskip("h5py")
    path = tmp_path / "a.h5"
    with h5py.File(path, "w") as file:
        file.create_dataset(
            "s", data=FRAMES, chunks=(2, 10, 10), compression="gzip", fletcher32=True
        )
    np.testing.assert_array_equal(read(path), FRAMES)
    with h5py.File(path) as file:
        infos = [file["s"].id.get_chunk_info(k) for k in range(3)]
    whole = path.read_bytes()
    for n, info in enumerate(infos):  # a key of the tree: size, filter mask, place of the chunk
        key = struct.pack("<II3Q", info.size, 0, *info.chunk_offset)
        assert whole.count(key) == 1
        damaged = tmp_path / f"{n}.h5"
        damaged.write_bytes(whole.replace(key, struct.pack("<II3Q", 0, 0, *info.chunk_offset)))
        with pytest.raises(
            lb.UnreadableFrame, match=r"h5 cannot be read: chunk .* of s is damaged"
        ):
            lb.open_frames(damaged)


def test_hdf5_links_to_other_files_and_to_itself_are_not_followed(tmp_path):
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "other.h5", "w") as file:
        file["stack"] = FRAMES
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["g/stack"] = FRAMES[:2]
        file["g/again"] = file["g"]
        file["elsewhere"] = h5py.ExternalLink("other.h5", "/stack")
    assert lb.open_frames(tmp_path / "a.h5").n_frames == 2


def test_a_video_in_grey_is_read_and_sought(tmp_path):
    path = str(tmp_path / "a.avi")
    smooth = (np.add.outer(np.arange(48), np.arange(64)) * 2).astype(np.uint8)
    out = cv2.VideoWriter(path, cv2.VideoWriter_fourcc(*"FFV1"), 25, (64, 48), isColor=True)
    if not out.isOpened():
        pytest.skip("this OpenCV writes no FFV1")
    for k in range(12):
        out.write(np.repeat((smooth + k)[..., None], 3, axis=-1))
    out.release()
    recording = lb.read_recording(path)
    frames = recording.stamps[0].frames
    assert frames.n_frames == 12
    for k in (11, 0, 5, 6, 3):
        assert np.abs(frames.read(k, k + 1)[0].astype(int) - (smooth + k)).max() <= 2
    np.testing.assert_allclose(recording.times.seconds, np.arange(12) / 25)
    assert recording.notes[0] == "Times come from the rate of a.avi, 25 frames a second."
