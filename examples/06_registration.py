"""A similarity from a mix of points, lines and planes, a third of them wrong; no ultrasound."""

import numpy as np
from scipy.spatial.transform import Rotation

from sonocal import registration as reg
from sonocal.geometry import Similarity

random = np.random.default_rng(0)
truth = Similarity(Rotation.random(random_state=1).as_matrix(), [10.0, 20.0, 30.0], 0.24)

points = random.uniform(0, 500, (12, 3))
lines = random.uniform(0, 500, (9, 2, 3))
points_seen = truth @ points + random.normal(scale=0.2, size=points.shape)
lines_seen = truth @ lines + random.normal(scale=0.2, size=lines.shape)
points_seen[:4] = random.uniform(-50, 150, (4, 3))  # these are nonsense
lines_seen[:3] = random.uniform(-50, 150, (3, 2, 3))

found = reg.register(
    reg.rows(reg.point_point(points, points_seen), reg.line_line(lines, lines_seen)), threshold_mm=2.0
)
print(found)
print("agree:", found.inlier.astype(int))
print("scale:", float(found.target_from_source.scale), "+-", float(np.sqrt(found.covariance[6, 6])) * 0.24)
print("true: ", 0.24)
