#!/bin/sh
# shapely on a plane of ground whose corners have heights, cut to what a foot reaches.
#
# Seen with shapely 2.2.0 (GEOS 3.14.1), a ramp of 2 x 1 m that rises by .5 (27 degrees), and a reach that is a rectangle:
# - .3 x .5 m: corners at heights of 0 and .5 m where the ramp is at .25 and .4 m, a slope of 59 degrees;
# - .2 x .4 m: all four at .5 m, where the ramp goes from .45 to .55 m: level ground;
# - .4 x .4 m: rises by .5 m along y, where the ramp is level, and not along x;
# - a reach that passes the end of the ramp: right where it cuts the border, wrong inside.
# A reach whose own corners are at height 0 puts the ground at 0. No height is nan, and nothing is said.
#
# Guess beforehand: "z has no effect on geometric analysis", so that heights are those of the ramp, or none, as buffer gives.
# A planner that takes the plane of a foothold from its corners stands on 59 degrees or .25 m below the ground.
# What seems to happen: a corner on the ramp's border is interpolated, any other gets the mean height of those of the ramp's
# corners that are in its cell of a grid of 3 x 3 over both shapes, or of all where there is none.
#
# Exits with 1 where any of it is otherwise.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
"${PYTHON:-python3}" -m venv env
env/bin/pip install --quiet --disable-pip-version-check --only-binary :all: "shapely==2.2.0" "numpy==2.4.6"
cat > reach.py <<'PYTHON'
import sys

import numpy as np
import shapely

RISE = 0.5
RAMP = shapely.Polygon([(x, y, RISE * x) for x, y in ((0, 0), (2, 0), (2, 1), (0, 1))])


def cut(reach):
    """Corners of what is reached, how far each is off the ramp, and the rise along x and y of the plane through them."""
    corners = shapely.get_coordinates(RAMP.intersection(reach), include_z=True)[:-1]
    plane = np.linalg.lstsq(np.column_stack([corners[:, :2], np.ones(len(corners))]), corners[:, 2], rcond=None)[0]
    return corners, np.abs(corners[:, 2] - RISE * corners[:, 0]), plane[:2]


print(f"shapely {shapely.__version__}, GEOS {shapely.geos_version_string}, a ramp of 27 degrees")
seen = []
for bounds in ((0.5, 0.25, 0.8, 0.75), (0.9, 0.3, 1.1, 0.7), (0.1, 0.1, 0.5, 0.5), (0.5, 0.25, 2.8, 0.75)):
    corners, off, rise = cut(shapely.box(*bounds))
    seen.append((off, rise))
    slope = np.degrees(np.arctan(np.hypot(*rise)))
    print(f"{bounds}: heights {corners[:, 2].round(2)} m, up to {off.max():.2f} m off, {slope:.0f} degrees")
below = cut(shapely.Polygon([(x, y, 0.0) for x, y in shapely.box(0.5, 0.25, 0.8, 0.75).exterior.coords]))[0]
shrunk = shapely.get_coordinates(RAMP.buffer(-0.1), include_z=True)
steep, level, across, past = seen
right = (
    np.allclose(steep[1], [5 / 3, 0])
    and np.allclose(level[1], 0)
    and np.allclose(across[1], [0, 1.25])
    and np.allclose(np.sort(past[0]), [0, 0, 0.25, 0.25])
    and not below[:, 2].any()
    and np.isnan(shrunk[:, 2]).all()
)
sys.exit(0 if right else "something is otherwise now")
PYTHON
env/bin/python reach.py
