#!/bin/sh
# coal: which way two links lead apart, where both are meshes, as most links of robots are.
#
# Seen with coal 3.0.3, two cubes with .2 m between them, each as a mesh (BVHModelOBBRSS) and as a box:
# - mesh and box, and box and box: distance .2 m, the normal is a unit vector along the line between the nearest points;
# - mesh and mesh: distance and nearest points are right, and the normal is no normal: its length is about 1e-322;
# - 5 cm inside each other, boxes, and a mesh and a box, say -.05 m; two meshes say 0, as the header allows, and no normal.
# collide has the normal and the depth of the same two meshes.
#
# Guess beforehand: a normal that is given is one. It is nan before the call, so that what is not known could have stayed so.
# The derivative of a clearance is that normal times the Jacobians of the points: it is 0, so that no step leads away from
# what a leg is about to hit, and nothing tells it from the derivative of links that cannot come closer.
# What seems to happen: two meshes hand over a normal that was never set, which is whatever lay there in memory.
#
# Exits with 1 where any of it is otherwise.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
"${PYTHON:-python3}" -m venv env
env/bin/pip install --quiet --disable-pip-version-check --only-binary :all: "coal==3.0.3" "libcoal==3.0.3" "numpy==2.4.6"
cat > apart.py <<'PYTHON'
import sys
from itertools import product

import coal
import numpy as np

FACES = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))


def box(side):
    return coal.Box(side, side, side)


def mesh(side):
    corners = np.array(list(product((-side / 2, side / 2), repeat=3)))
    model = coal.BVHModelOBBRSS()
    model.beginModel(2 * len(FACES), len(corners))
    for a, b, c, d in FACES:
        model.addTriangle(corners[a], corners[b], corners[c])
        model.addTriangle(corners[a], corners[c], corners[d])
    model.endModel()
    return model


print(f"coal {coal.__version__}")
right, here = True, coal.Transform3s()
for gap in (0.2, -0.05):
    there = coal.Transform3s(np.eye(3), np.array([0.3 + gap, 0.03, 0.02]))
    for first, second in ((box, box), (mesh, box), (mesh, mesh)):
        result = coal.DistanceResult()
        distance = coal.distance(first(0.4), here, second(0.2), there, coal.DistanceRequest(True, True), result)
        normal = np.array(result.normal)
        points = np.array(result.getNearestPoint2()) - np.array(result.getNearestPoint1())
        meshes = second is mesh
        name = f"{first.__name__} and {second.__name__}"
        length = np.linalg.norm(normal)
        print(f"{name:13} {gap:+.2f} m apart: distance {distance:+.3f} m, a normal of length {length:.3g}")
        right &= abs(distance - (max(gap, 0.0) if meshes else gap)) < 1e-6
        right &= not abs(length - 1) < 1e-3 if meshes else np.allclose(normal, [1, 0, 0], atol=1e-6)
        if gap > 0:
            right &= np.allclose(points, [gap, 0, 0], atol=1e-6)
contacts = coal.CollisionResult()
request = coal.CollisionRequest(coal.CollisionRequestFlag.CONTACT, 1)
coal.collide(mesh(0.4), here, mesh(0.2), there, request, contacts)
contact = contacts.getContact(0)
print(f"collide: depth {contact.penetration_depth:+.3f} m, normal {np.array(contact.normal).round(6)}")
right &= abs(contact.penetration_depth + 0.05) < 1e-6 and np.allclose(contact.normal, [1, 0, 0], atol=1e-6)
sys.exit(0 if right else "something is otherwise now")
PYTHON
env/bin/python apart.py
