"""Run the command line as ``python -m losbench.cli``."""

import sys

from losbench.cli import main

sys.exit(main())
