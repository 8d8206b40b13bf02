"""A table of sightings of your own: points of images against the needle's ends in the frame of the probe's marker.

Writes sightings.csv and reads it again, as you would read your own.
"""

from dataclasses import replace

import numpy as np

import sonocal as sc
from sonocal.simulation.scene import simulate_observations

simulated = simulate_observations(dimension=2, needles=60, sigma_px=1.0, sigma_mm=0.5, seed=1)
rows = replace(simulated.observations, split=np.where(np.arange(60) % 3 == 0, "test", "fit"))
sc.write_observations(rows, "sightings.csv")

table = sc.read_observations("sightings.csv")
calibration = sc.calibrate(table, test_split="test")  # a third of the rows is held out
print(f"fitted rows:   {calibration.fit.rms_mm:.2f} mm rms")
print(f"held-out rows: {calibration.test.rms_mm:.2f} mm rms")

# Where is a pixel, and how well is that known?
places_mm, covariance = calibration.predict([[250, 250], [0, 499]])
for place, spread in zip(places_mm, np.sqrt(np.trace(covariance, axis1=1, axis2=2)), strict=True):
    print(place.round(2), f"mm, known to {spread:.2f} mm (rms)")

off = np.linalg.norm(
    places_mm - simulated.probe_from_image @ np.array([[250.0, 250.0], [0.0, 499.0]]), axis=1
)
print("really off by", off.round(2), "mm")
