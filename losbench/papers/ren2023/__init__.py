"""ren2023: boresight drift of a pair of star cameras, measured by reference spots and taken out of
their attitudes.

Ren et al., "Boresight drift correction and on-orbit evaluation for the high-precision star camera",
Spacecraft Recovery & Remote Sensing 44(4), 2023, doi 10.3969/j.issn.1009-8518.2023.04.002.
"""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
