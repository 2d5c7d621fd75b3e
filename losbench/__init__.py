"""losbench: where a space camera really points, from pixels to angles.

The public names are listed once, in ``__init__.pyi``, and loaded on first use.
"""

import lazy_loader as _lazy

from losbench.__about__ import __version__ as __version__

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
