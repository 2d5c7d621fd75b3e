"""Writers of frame files, by the formats' own descriptions where no library writes them."""

import struct

import cv2
import numpy as np

TICKS_1970 = 621_355_968_000_000_000


def tiff(path, pages, *, bits=16, order="<", tags=(), photometric=1, samples=1, big=False):
    """Write byte strings as pages of a TIFF, uncompressed; ``pages`` are (data, rows, cols)."""
    wide = "Q" if big else "I"
    head = b"II" if order == "<" else b"MM"
    out = bytearray(
        head
        + (struct.pack(order + "HHHQ", 43, 8, 0, 0) if big else struct.pack(order + "HI", 42, 0))
    )
    link = len(out) - struct.calcsize(wide)
    for data, rows, columns in pages:
        at = len(out)
        out += data
        entries = {
            256: columns,
            257: rows,
            258: bits,
            259: 1,
            262: photometric,
            273: at,
            277: samples,
            278: rows,
            279: len(data),
        }
        entries |= dict(tags)
        directory = len(out)
        out[link : link + struct.calcsize(wide)] = struct.pack(order + wide, directory)
        out += struct.pack(order + ("Q" if big else "H"), len(entries))
        for tag, value in sorted(entries.items()):
            if isinstance(value, tuple):  # shorts in the entry itself
                out += struct.pack(order + "HH" + wide, tag, 3, len(value))
                out += struct.pack(f"{order}{len(value)}H", *value).ljust(
                    struct.calcsize(wide), b"\0"
                )
            else:
                out += struct.pack(order + "HH" + wide + wide, tag, 16 if big else 4, 1, value)
        link = len(out)
        out += bytes(struct.calcsize(wide))
    path.write_bytes(bytes(out))
    return path


def tiff16(path, frames, **options):
    return tiff(path, [(f.astype("<u2").tobytes(), *f.shape) for f in frames], **options)


def tiff12(path, frames):
    """Twelve bits, the high ones first, rows at whole bytes (TIFF 6.0, fill order 1)."""
    pages = []
    for frame in frames:
        bits = np.unpackbits(frame.astype(">u2").view(np.uint8).reshape(*frame.shape, 2), axis=-1)
        rows = np.packbits(bits[..., 4:].reshape(len(frame), -1), axis=-1)
        pages.append((rows.tobytes(), *frame.shape))
    return tiff(path, pages, bits=12)


def ser(path, frames, *, depth=12, order="<", flag=0, ticks=None, colour=0):
    rows, columns = frames[0].shape[:2]
    head = struct.pack(
        "<14s7i40s40s40s2q",
        b"LUCAM-RECORDER",
        0,
        colour,
        flag,
        columns,
        rows,
        depth,
        len(frames),
        b"",
        b"",
        b"",
        0,
        0,
    )
    body = b"".join(f.astype(f"{order}u2" if depth > 8 else "u1").tobytes() for f in frames)
    path.write_bytes(head + body + (b"" if ticks is None else np.asarray(ticks, "<i8").tobytes()))
    return path


def raw(path, frames, pixels, *, header_bytes=0, gap_bytes=0, byte_order="little"):
    """Write raw frames and the TOML file that describes them; return the latter."""
    data = []
    for frame in frames:
        flat = frame.ravel().astype("<u2")
        if pixels == "mono12packed":
            even, odd = flat[0::2], flat[1::2]
            data.append(
                np.stack([even >> 4, (even & 15) | (odd & 15) << 4, odd >> 4], axis=-1)
                .astype(np.uint8)
                .tobytes()
            )
        elif pixels.endswith("p"):
            bits = np.unpackbits(flat.view(np.uint8).reshape(-1, 2), axis=-1, bitorder="little")
            data.append(
                np.packbits(bits[:, : int(pixels[4:6])].ravel(), bitorder="little").tobytes()
            )
        else:
            data.append(flat.astype("<u2" if byte_order == "little" else ">u2").tobytes())
    path.with_suffix(".raw").write_bytes(bytes(header_bytes) + bytes(gap_bytes).join(data))
    toml = path.with_suffix(".toml")
    toml.write_text(
        f'file = "{path.stem}.raw"\npixels = "{pixels}"\nshape = {list(frames[0].shape)}\n'
        f'header_bytes = {header_bytes}\ngap_bytes = {gap_bytes}\nbyte_order = "{byte_order}"\n'
    )
    return toml


def images(folder, frames, suffix):
    folder.mkdir()
    for k, frame in enumerate(frames):
        assert cv2.imwrite(str(folder / f"frame-{k}{suffix}"), frame)
    return folder


def every_kind(folder, frames):
    """Write twelve-bit frames in every format that holds them exactly; return what to open, by name."""
    import gzip

    import h5py
    from astropy.io import fits

    kinds = {
        "png": images(folder / "png", frames, ".png"),
        "pgm": images(folder / "pgm", frames, ".pgm"),
        "lzw": images(folder / "lzw", frames, ".tif"),
        "tiff": tiff16(folder / "plain.tif", frames),
        "bigtiff": tiff16(folder / "big.btf", frames, big=True),
        "tiff12": tiff12(folder / "packed.tif", frames),
        "ser": ser(folder / "a.ser", frames),
        "ser-big": ser(folder / "big.ser", frames, order=">", flag=1),
        "mono12": raw(
            folder / "mono12", frames, "mono12", header_bytes=7, gap_bytes=3, byte_order="big"
        ),
        "mono12p": raw(folder / "mono12p", frames, "mono12p"),
        "mono12packed": raw(folder / "mono12packed", frames, "mono12packed", gap_bytes=5),
        "npy": folder / "a.npy",
        "npy-big": folder / "big.npy",
        "npy-fortran": folder / "fortran.npy",
        "npz": folder / "a.npz",
        "npz-stored": folder / "stored.npz",
        "fits": folder / "a.fits",
        "fits.gz": folder / "a.fits.gz",
        "fits-many": folder / "many.fits",
        "fits.fz": folder / "a.fits.fz",
        "hdf5": folder / "a.h5",
        "hdf5-chunks": folder / "chunks.h5",
    }
    cv2.imwritemulti(str(folder / "pages.tif"), list(frames))
    kinds["tiff-lzw-pages"] = folder / "pages.tif"
    np.save(kinds["npy"], frames)
    np.save(kinds["npy-big"], frames.astype(">u2"))
    np.save(kinds["npy-fortran"], np.asfortranarray(frames))
    np.savez_compressed(kinds["npz"], other=np.zeros(3), frames=frames)
    np.savez(kinds["npz-stored"], frames)
    fits.PrimaryHDU(frames).writeto(kinds["fits"])
    kinds["fits.gz"].write_bytes(gzip.compress(kinds["fits"].read_bytes()))
    fits.HDUList([fits.PrimaryHDU(), *map(fits.ImageHDU, frames)]).writeto(kinds["fits-many"])
    fits.HDUList([fits.PrimaryHDU(), fits.CompImageHDU(frames)]).writeto(kinds["fits.fz"])
    with h5py.File(kinds["hdf5"], "w") as file:
        file["entry/data"] = frames
    with h5py.File(kinds["hdf5-chunks"], "w") as file:
        file.create_dataset("stack", data=frames, chunks=(4, 16, 16), compression="gzip")
    return kinds
