"""liu2026: thermal line-of-sight pointing from two laser spots.

Liu, Chen, Bi, Fu, Zhao, Zhang, "Thermal line-of-sight pointing analysis of a space camera based on
the IRLS algorithm", Chinese Optics (2026), doi 10.37188/CO.2026-0039.
"""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
