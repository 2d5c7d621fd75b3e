"""liu2026: thermal line-of-sight pointing from two laser spots.

Liu, Chen, Bi, Fu, Zhao, Zhang, "Thermal line-of-sight pointing analysis of a space camera based on the IRLS
algorithm", Chinese Optics (2026), doi 10.37188/CO.2026-0039.
"""
