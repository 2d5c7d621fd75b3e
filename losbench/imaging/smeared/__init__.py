"""Stars that smear while the camera shakes, and a gyro that knows how.

lyu2015: Lyu, Zhang, Wang, Wu, "Star spot centroiding method with inertial measurement information",
Journal of NUDT 37(2), 2015, doi 10.11887/j.cn.201502029.
"""
