"""The papers: the scenario of each, its twin, one function per figure and table, and what the twin
writes to disk.
"""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
