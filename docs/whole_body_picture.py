"""Draw the picture of person, robot and object anew, at the beginning and the end of a loop.

Run ``python docs/whole_body_picture.py``.

Needs the extras ``mink`` and ``learn`` (matplotlib), and a machine on which MuJoCo can draw off the
screen.
"""

import os
from pathlib import Path

os.environ.setdefault("MUJOCO_GL", "egl")

import mujoco
import numpy as np
from matplotlib.image import imsave

import ergoqp
from ergoqp.rest.best_place import awkward_start
from ergoqp.rest.model_person import sample_person
from ergoqp.whole_body import WholeBody
from ergoqp.whole_body.loop import run_whole_body

WIDTH, HEIGHT = 560, 640

problem = ergoqp.load_problem("screwing")
person = sample_person(problem, 0, body=problem.response.body)
posture = awkward_start(problem, person, 1, 10)
whole = WholeBody(problem, posture=posture)
trace = run_whole_body(whole, person, posture, duration=10.0)

model = whole.scene.model
model.vis.global_.offwidth, model.vis.global_.offheight = WIDTH, HEIGHT
model.vis.headlight.ambient[:] = 0.45
model.vis.headlight.diffuse[:] = 0.5
camera = mujoco.MjvCamera()
camera.lookat[:], camera.distance, camera.azimuth, camera.elevation = (
    [0.55, -0.05, 0.95],
    2.9,
    115,
    -10,
)
data, views = mujoco.MjData(model), []
with mujoco.Renderer(model, HEIGHT, WIDTH) as renderer:
    for sample in (0, -1):
        pelvis = person.contact(trace.postures[sample])[1]
        place = [*pelvis[:3, 3], np.arctan2(pelvis[1, 0], pelvis[0, 0])]
        data.qpos[:] = whole.scene.qpos(np.array(place), trace.postures[sample], trace.arms[sample])
        mujoco.mj_forward(model, data)
        renderer.update_scene(data, camera)
        # The sky is empty: the paper shows.
        view = renderer.render().copy()
        renderer.enable_segmentation_rendering()
        renderer.update_scene(data, camera)
        view[renderer.render()[:, :, 0] < 0] = 255
        renderer.disable_segmentation_rendering()
        views.append(view)
picture = Path(__file__).parent / "images" / "whole_body.png"
imsave(picture, np.hstack(views))
scores = problem.assess(np.array([trace.postures[0], trace.postures[-1]])).final
print(
    picture,
    picture.stat().st_size,
    "bytes, REBA",
    *scores.tolist(),
    f"nearest {min(trace.distances):.3f} m",
)
