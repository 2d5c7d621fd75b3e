from .design import design_three_mirror as design_three_mirror
from .jacobian import jacobian_table as jacobian_table
from .jacobian import los_angles as los_angles
from .jacobian import los_jacobian as los_jacobian
from .rays import Rays as Rays
from .threemirror import ThreeMirror as ThreeMirror
