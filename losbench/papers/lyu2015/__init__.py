"""lyu2015: star spot centroids under vibration, aided by a gyro.

Lyu, Zhang, Wang, Wu, "Star spot centroiding method with inertial measurement information", Journal
of NUDT 37(2), 2015, doi 10.11887/j.cn.201502029.
"""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
