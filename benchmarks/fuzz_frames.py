"""Frame files for ``fuzz.py``: whole ones of every kind, and what it is to read a damaged one.

``python benchmarks/fuzz.py tiff --cases 10000``
"""

import sys
import tempfile
from pathlib import Path

import numpy as np

import losbench as lb

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "recording"))
import files_of_frames as write

FRAMES = np.random.default_rng(7).poisson(900, (4, 24, 32)).astype(np.uint16)


def read(path, **options):
    """Open, and read the first and the last frames, once stopping and once skipping."""
    for on_unreadable in ("stop", "skip"):
        recording = lb.read_recording(path, on_unreadable=on_unreadable, **options)
        last = recording.n_frames
        for stamp in recording.stamps[:4]:
            for first in sorted({0, max(0, last - 2)}):
                stamp.read(first, min(last, first + 2), skip=on_unreadable == "skip")
        recording.label(last - 1)


def _tiff(folder):
    import tifffile

    yield write.tiff16(folder / "a.tif", FRAMES)
    yield write.tiff16(folder / "b.btf", FRAMES, big=True)
    yield write.tiff12(folder / "c.tif", FRAMES)
    yield write.tiff16(folder / "d.tif", FRAMES, order="<", photometric=0)
    tifffile.imwrite(folder / "e.tif", FRAMES, imagej=True, photometric="minisblack")
    tifffile.imwrite(folder / "f.tif", FRAMES, compression="zlib", photometric="minisblack")
    tifffile.imwrite(folder / "g.tif", FRAMES, tile=(16, 16), photometric="minisblack")
    yield from (folder / f"{name}.tif" for name in "efg")
    yield write.images(folder / "lzw", FRAMES[:1], ".tif") / "frame-0.tif"


def _image(folder):
    small = (FRAMES >> 4).astype(np.uint8)
    for suffix, frames in ((".png", FRAMES), (".pgm", FRAMES), (".bmp", small), (".jpg", small)):
        yield write.images(folder / suffix[1:], frames[:1], suffix) / f"frame-0{suffix}"
    (folder / "text.pgm").write_text("P2\n# text\n4 2\n4095\n0 7 9 4095\n1 2 3 4\n")
    yield folder / "text.pgm"
    colour = np.repeat(small[:1, ..., None], 3, axis=-1)
    yield write.images(folder / "colour", colour, ".png") / "frame-0.png"


def _numpy(folder):
    np.save(folder / "a.npy", FRAMES)
    np.save(folder / "b.npy", np.asfortranarray(FRAMES.astype(">i4")))
    np.savez(folder / "c.npz", FRAMES)
    np.savez_compressed(folder / "d.npz", frames=FRAMES, other=np.zeros(3))
    yield from (folder / name for name in ("a.npy", "b.npy", "c.npz", "d.npz"))


def _fits(folder):
    import bz2
    import gzip

    from astropy.io import fits

    cube = fits.PrimaryHDU(FRAMES)
    cube.header.update({"CTYPE3": "TIME", "BLANK": -5})
    cube.writeto(folder / "a.fits")
    extensions = [fits.ImageHDU(frame, name=name) for frame in FRAMES[:2] for name in ("SCI", "DQ")]
    for k, extension in enumerate(extensions):
        extension.header["DATE-OBS"] = f"2026-03-01T12:00:0{k}"
    fits.HDUList([fits.PrimaryHDU(), *extensions]).writeto(folder / "b.fits")
    fits.HDUList([fits.PrimaryHDU(), fits.CompImageHDU(FRAMES)]).writeto(folder / "c.fits.fz")
    (folder / "d.fits.gz").write_bytes(gzip.compress((folder / "a.fits").read_bytes()))
    (folder / "e.fits.bz2").write_bytes(bz2.compress((folder / "a.fits").read_bytes()))
    yield from (
        folder / name for name in ("a.fits", "b.fits", "c.fits.fz", "d.fits.gz", "e.fits.bz2")
    )
    flux = FRAMES[:, :8, :8].astype("f4")
    columns = [
        fits.Column("TIME", "D", array=1000 + np.arange(4) / 720),
        fits.Column("FLUX", "64E", dim="(8,8)", array=flux),
        fits.Column("FLUX_ERR", "64E", dim="(8,8)", array=np.sqrt(flux)),
        fits.Column("QUALITY", "J", array=np.array([0, 4, 0, 0])),
    ]
    stamp = fits.HDUList([fits.PrimaryHDU(), fits.BinTableHDU.from_columns(columns)])
    stamp.writeto(folder / "tpf.fits")
    yield folder / "tpf.fits"


def _hdf5(folder):
    import h5py

    with h5py.File(folder / "a.h5", "w") as file:
        file["entry/data"] = FRAMES
    with h5py.File(folder / "b.h5", "w") as file:
        file.create_dataset("s", data=FRAMES, chunks=(2, 8, 8), compression="gzip", fletcher32=True)
    yield from (folder / "a.h5", folder / "b.h5")


def _ser(folder):
    ticks = write.TICKS_1970 + 17_700_000_000_000_000 + np.arange(4) * 100_000
    yield write.ser(folder / "a.ser", FRAMES, ticks=ticks)
    yield write.ser(folder / "b.ser", np.repeat(FRAMES[..., None], 3, axis=-1), colour=101)


def _raw(folder):
    """The description is what is damaged; the frames lie beside it."""
    for pixels in ("mono12", "mono12p", "mono12packed"):
        yield write.raw(folder / pixels, FRAMES, pixels, header_bytes=3, gap_bytes=2)


def _video(folder):
    import cv2

    for fourcc, suffix in (("FFV1", ".avi"), ("MJPG", ".avi"), ("mp4v", ".mp4")):
        path = folder / f"{fourcc}{suffix}"
        out = cv2.VideoWriter(
            str(path), cv2.VideoWriter_fourcc(*fourcc), 25, (32, 24), isColor=True
        )
        for frame in FRAMES:
            out.write(np.repeat((frame >> 4).astype(np.uint8)[..., None], 3, axis=-1))
        out.release()
        if path.exists() and path.stat().st_size:
            yield path


def _made(writer):
    """Return whole files by name: their bytes, and those of what must lie beside them."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        whole = {path.name: path.read_bytes() for path in writer(folder)}
        beside = {path.name: path.read_bytes() for path in folder.glob("*.raw")}
    return whole, beside


def read_video(path):
    """Lossy colours of a grey image differ: one channel is named."""
    read(path, channel="green")


# A door: how its whole files are made, and what reads one.
DOORS = {
    name: (lambda writer=writer: _made(writer), read_video if writer is _video else read)
    for name, writer in {
        "tiff": _tiff,
        "image": _image,
        "numpy": _numpy,
        "fits": _fits,
        "hdf5": _hdf5,
        "ser": _ser,
        "raw": _raw,
        "video": _video,
    }.items()
}
