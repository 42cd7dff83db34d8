"""ref.py OUT spp: reference of ajar at 320x180 by path"""
import sys
import numpy as np
import mitsuba_restir, mitsuba as mi, drjit as dr
from mitsuba_restir.studies.config.files import load_study
from mitsuba_restir.studies.runs.scene import load_scene
from mitsuba_restir.studies.runs import rendering
study = load_study(sys.argv[1]); scene = load_scene(study)
sensor = rendering.make_sensor(study, scene, (320, 180))
it = mi.load_dict({"type": "path", "max_depth": study.max_depth})
n = int(sys.argv[3]) // 64
acc = 0; sq = 0
for i in range(n):
    x = np.array(mi.render(scene, integrator=it, sensor=sensor, spp=64, seed=1000 + i), dtype=np.float64)[..., :3]
    acc = acc + x; sq = sq + x * x
mean = acc / n; var = (sq / n - mean**2) / (n - 1)
np.savez(sys.argv[2], mean=mean, var=var)
