"""Make ``batoid_rays.json``: rays through a three-mirror camera at rest and moved, by batoid.

Run once with batoid 0.9.0 in an environment of its own (``pip install batoid``; the library never
imports it): ``python batoid_rays.py > batoid_rays.json``. A pose is three translations (mm) and a
rotation vector (rad) about the optic's pivot.
"""

import json
import sys

import numpy as np

RADIUS = [542.46, 171.93, 251.7]
CONIC = [-1.6168, 0.0, 0.1954]
VERTEX = [0.0, 148.6, 0.0, 176.91]
PIVOT = [[0, 35.13841, 1.13733], [0, 0, 148.6], [0, -34.8318, 2.42407], [0, -27.10342, 176.91]]


def main():
    import batoid
    from scipy.spatial.transform import Rotation

    rng = np.random.default_rng(20260017)
    # Rays that come down near the middle of the field, over the whole beam.
    tilt = np.radians(6.0) + rng.uniform(-0.02, 0.02, 24)
    across = rng.uniform(-0.03, 0.03, 24)
    direction = -np.stack([across, np.sin(tilt), np.cos(tilt)], axis=-1)
    direction /= np.linalg.norm(direction, axis=-1, keepdims=True)
    at_mirror = np.array([0.0, 35.1, 0.0]) + np.append(
        rng.uniform(-14, 14, (24, 2)), np.zeros((24, 1)), axis=1
    )
    origin = at_mirror - direction * (300.0 / -direction[:, 2:])
    poses = np.concatenate(
        [rng.uniform(-0.05, 0.05, (3, 4, 3)), rng.uniform(-2e-4, 2e-4, (3, 4, 3))], axis=-1
    )
    poses[0] = 0.0
    places = []
    for pose in poses:
        rays = batoid.RayVector(*origin.T, *direction.T)
        for i in range(4):
            turn = Rotation.from_rotvec(pose[i, 3:]).as_matrix()
            vertex = np.array([0.0, 0.0, VERTEX[i]])
            pivot = np.array(PIVOT[i])
            place = pivot + pose[i, :3] + turn @ (vertex - pivot)
            system = batoid.CoordSys(place, turn)
            if i < 3:
                batoid.Quadric(RADIUS[i], CONIC[i]).reflect(rays, coordSys=system)
            else:
                batoid.Plane().intersect(rays, coordSys=system)
        places.append(rays.r[:, :2].tolist())
    sys.stdout.write(
        json.dumps(
            {
                "made_with": f"batoid {batoid.__version__}, tests/optics/batoid_rays.py",
                "radius_mm": RADIUS,
                "conic": CONIC,
                "vertex_z_mm": VERTEX,
                "pivot_mm": PIVOT,
                "origin_mm": origin.tolist(),
                "direction": direction.tolist(),
                "poses": poses.tolist(),
                "detector_xy_mm": places,
            }
        )
    )


if __name__ == "__main__":
    main()
