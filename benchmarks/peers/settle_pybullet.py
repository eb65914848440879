"""Convex grains that settle in PyBullet: python settle_pybullet.py GRAINS.npz POSES.npz.

The input has position (n, 3), orientation (n, 4) as (w, x, y, z), shape (n,), vertices (k, v, 3), lengths (3,) and
friction, with the corner of the box at the origin, and walls on all sides. Gravity is 9.81, the median diameter is 1.
Prints the CPU seconds.
"""

import sys
import time

import numpy as np
import pybullet

#: time step, and steps at the most; energy, in m g d, at the end
STEP, LONGEST, CALM, GRAVITY = 1 / 240, 6000, 1e-4, 9.81

grains = np.load(sys.argv[1])
position, orientation, lengths = grains["position"], grains["orientation"], grains["lengths"]
friction = float(grains["friction"])
began = time.process_time()
pybullet.connect(pybullet.DIRECT)
pybullet.setGravity(0, 0, -GRAVITY)
pybullet.setTimeStep(STEP)
normals = [np.eye(3)[axis] * side for axis in range(3) for side in (1, -1)]
for k, normal in enumerate(normals):
    base = np.zeros(3) if k % 2 == 0 else lengths * np.abs(normal)
    plane = pybullet.createCollisionShape(pybullet.GEOM_PLANE, planeNormal=normal.tolist())
    body = pybullet.createMultiBody(0, plane, basePosition=base.tolist())
    pybullet.changeDynamics(body, -1, lateralFriction=friction, restitution=0.0)
shapes = [
    pybullet.createCollisionShape(pybullet.GEOM_MESH, vertices=vertices.tolist()) for vertices in grains["vertices"]
]
bodies = []
for place, turn, shape in zip(position, orientation, grains["shape"], strict=True):
    body = pybullet.createMultiBody(1.0, shapes[shape], -1, place.tolist(), turn[[1, 2, 3, 0]].tolist())
    pybullet.changeDynamics(body, -1, lateralFriction=friction, restitution=0.0, collisionMargin=0.0)
    bodies.append(body)
for k in range(LONGEST):
    pybullet.stepSimulation()
    if k % 100 == 99:
        speeds = np.array([pybullet.getBaseVelocity(body)[0] for body in bodies])
        if 0.5 * (speeds**2).sum(axis=1).mean() < CALM * GRAVITY:
            break
poses = [pybullet.getBasePositionAndOrientation(body) for body in bodies]
sys.stdout.write(f"{time.process_time() - began}\n")
np.savez(
    sys.argv[2],
    position=np.array([place for place, _ in poses]),
    orientation=np.array([turn for _, turn in poses])[:, [3, 0, 1, 2]],
)
