"""What `import losbench` costs beside `import numpy`: each in fresh interpreters, in turn, the best
of several.
"""

import subprocess
import sys

from side_by_side import report, within


def seconds(module: str) -> float:
    code = f"import time; t = time.perf_counter(); import {module}; print(time.perf_counter() - t)"
    return float(
        subprocess.run(
            [sys.executable, "-c", code], capture_output=True, text=True, check=True
        ).stdout
    )


def main() -> None:
    pairs = [(seconds("numpy"), seconds("losbench")) for _ in range(9)]
    numpy, losbench = (min(column) for column in zip(*pairs, strict=True))
    report("import", [within("import losbench", losbench, "import numpy", numpy, 4.0)])


if __name__ == "__main__":
    main()
