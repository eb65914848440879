"""Convex grains that settle in MuJoCo: python settle_mujoco.py GRAINS.npz POSES.npz.

Input and output are those of settle_pybullet.py. Prints the CPU seconds.
"""

import sys
import time

import mujoco
import numpy as np

#: time step, and steps at the most; energy, in m g d, at the end
STEP, LONGEST, CALM, GRAVITY = 4e-3, 3000, 1e-4, 9.81

grains = np.load(sys.argv[1])
lengths, friction = grains["lengths"], float(grains["friction"])
meshes = "".join(
    f'<mesh name="m{k}" vertex="{" ".join(f"{x:.9g}" for x in vertices.ravel())}"/>'
    for k, vertices in enumerate(grains["vertices"])
)
planes = "".join(
    f'<geom type="plane" size="0 0 1" pos="{" ".join(map(str, place))}" zaxis="{" ".join(map(str, normal))}"/>'
    for axis in range(3)
    for side in (1.0, -1.0)
    for normal in [np.eye(3)[axis] * side]
    for place in [np.zeros(3) if side > 0 else lengths * np.eye(3)[axis]]
)
bodies = "".join(
    f'<body pos="{" ".join(map(str, place))}" quat="{" ".join(map(str, turn))}"><freejoint/>'
    f'<geom type="mesh" mesh="m{shape}" density="1000"/></body>'
    for place, turn, shape in zip(grains["position"], grains["orientation"], grains["shape"], strict=True)
)
model_text = f"""<mujoco><option timestep="{STEP}" gravity="0 0 {-GRAVITY}" cone="elliptic" solver="Newton"/>
<size memory="1G"/><default><geom friction="{friction} 0 0" condim="3"/></default><asset>{meshes}</asset>
<worldbody>{planes}{bodies}</worldbody></mujoco>"""
began = time.process_time()
model = mujoco.MjModel.from_xml_string(model_text)
data = mujoco.MjData(model)
n = len(grains["position"])
for k in range(LONGEST):
    mujoco.mj_step(model, data)
    if k % 100 == 99:
        speeds = data.qvel.reshape(n, 6)[:, :3]
        if 0.5 * (speeds**2).sum(axis=1).mean() < CALM * GRAVITY:
            break
poses = data.qpos.reshape(n, 7)
sys.stdout.write(f"{time.process_time() - began}\n")
np.savez(sys.argv[2], position=poses[:, :3], orientation=poses[:, 3:])
