from . import exercises as exercises
from . import explorers as explorers
