from . import liu2026 as liu2026
from . import lyu2015 as lyu2015
from . import ren2023 as ren2023
from .provenance import assumptions as assumptions
