"""From heat to line of sight: one brick mesh for temperatures and displacements, an exact map to
the spots.
"""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
