"""What `import losbench` costs beside `import numpy`: each in fresh interpreters, in turn, the best
of several.
"""

import statistics
import subprocess
import sys

LIMIT = 4.0


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
    median = statistics.median(ours / theirs for theirs, ours in pairs)
    print(f"import numpy    {1e3 * numpy:7.1f} ms")
    print(f"import losbench {1e3 * losbench:7.1f} ms")
    print(f"ratio {losbench / numpy:.2f}, median {median:.2f}, at most {LIMIT}")
    sys.exit(losbench / numpy > LIMIT)


if __name__ == "__main__":
    main()
