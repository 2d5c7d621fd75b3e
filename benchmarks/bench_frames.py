"""Late frames of long recordings: against the first, against OpenCV's walk, against one read of the
bytes.
"""

import gzip
import sys
import tempfile
from pathlib import Path

import cv2
import numpy as np
from astropy.io import fits
from side_by_side import faster, in_turn, one_thread, report, within

import losbench as lb

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "recording"))
import files_of_frames as write

PAGES, ROUNDS, LATEST_S = 4000, 15, 2e-3


def main() -> None:
    rng = np.random.default_rng(1)
    small = rng.poisson(900, (50, 64, 64)).astype(np.uint16)
    rows = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        path = write.tiff16(folder / "pages.tif", np.concatenate([small] * (PAGES // 50)))
        frames = lb.open_frames(path)

        def last_by_opencv() -> None:
            cv2.imreadmulti(str(path), start=PAGES - 1, count=1, flags=cv2.IMREAD_UNCHANGED)

        ours, theirs = in_turn(lambda: frames.read(PAGES - 1, PAGES), last_by_opencv, 5)
        rows.append(faster(f"page {PAGES} of {PAGES}", ours, "cv2.imreadmulti", theirs, 50))
        ours, first = in_turn(
            lambda: frames.read(PAGES - 1, PAGES), lambda: frames.read(0, 1), ROUNDS
        )
        rows.append(within(f"page {PAGES} of {PAGES}", ours, "page 1", first, 1.5))
        rows.append(within(f"page {PAGES} of {PAGES}", ours, "2 ms", LATEST_S, 1.0))

        whole = folder / "cube.fits"
        fits.PrimaryHDU(np.concatenate([small] * 10)).writeto(whole)
        (folder / "cube.fits.gz").write_bytes(gzip.compress(whole.read_bytes(), 1))
        many = [fits.ImageHDU(frame) for frame in np.concatenate([small] * 8)]
        fits.HDUList([fits.PrimaryHDU(), *many]).writeto(folder / "many.fits")
        for file in ("cube.fits.gz", "many.fits"):
            frames = lb.open_frames(folder / file)
            last = frames.n_frames - 1
            ours, first = in_turn(
                lambda f=frames, k=last: f.read(k, k + 1), lambda f=frames: f.read(0, 1), ROUNDS
            )
            rows.append(within(f"frame {last + 1} of {file}", ours, "frame 1", first, 1.5))
            rows.append(within(f"frame {last + 1} of {file}", ours, "2 ms", LATEST_S, 1.0))

        full = rng.poisson(900, (8, 1080, 1920)).astype(np.uint16)
        np.save(folder / "full.npy", full)
        kinds = {
            "full HD .npy": folder / "full.npy",
            "full HD TIFF": write.tiff16(folder / "full.tif", full),
            "full HD SER": write.ser(folder / "full.ser", full),
        }
        fits.PrimaryHDU(full).writeto(folder / "full.fits")
        kinds["full HD FITS"] = folder / "full.fits"
        room = np.empty((1, 1080, 1920), np.uint16)
        for what, file in kinds.items():
            frames = lb.open_frames(file)
            plain = file.open("rb", buffering=0)

            def bytes_alone(plain=plain) -> None:
                plain.seek(4096)
                plain.readinto(room)

            ours, alone = in_turn(lambda f=frames: f.read(6, 7, room), bytes_alone, ROUNDS)
            # FITS holds uint16 in the other order and less 32768.
            rows.append(
                within(what, ours, "its bytes alone", alone, 8.0 if "FITS" in what else 4.0)
            )
            plain.close()
        packed = lb.open_frames(write.raw(folder / "full12", full, "mono12p"))
        ours, alone = in_turn(
            lambda: packed.read(6, 7), lambda: np.unpackbits(full[0].view(np.uint8)[:, :2880]), 7
        )
        rows.append(within("full HD mono12p", ours, "np.unpackbits of its bytes", alone, 12.0))
    report("frames", rows)


if __name__ == "__main__":
    one_thread()
    main()
