"""capture.py STUDY CHAINS OUT [w h]: dump plain averages, estimators, motion of U chains."""
import sys, time
import numpy as np
import mitsuba_restir, mitsuba as mi, drjit as dr
from mitsuba_restir.studies.config.files import load_study
from mitsuba_restir.studies.runs.scene import load_scene
from mitsuba_restir.studies.runs import rendering
from mitsuba_restir.integrators import frame as F, recording
from mitsuba_restir.neighbors.around import similar_neighbors
from mitsuba_restir.neighbors.color_history import no_color_history, remember
from mitsuba_restir.passes.shade import AOVS
name, chains, out = sys.argv[1], int(sys.argv[2]), sys.argv[3]
size = tuple(map(int, sys.argv[4:6])) if len(sys.argv) > 5 else (320, 180)
extra = dict(kv.split("=") for kv in sys.argv[6:])
study = load_study(name)
scene = load_scene(study)
init = recording.Stage.__init__
def patched(self, *a):
    init(self, *a); self._recordable = False
recording.Stage.__init__ = patched
cap = {}
repro = F.reproject
def reproject(*a):
    m = repro(*a); cap["motion"] = m; return m
F.reproject = reproject
sp = F.spatial
def spatial(*a):
    m = sp(*a); cap.setdefault("rounds", []).append(m); return m
F.spatial = spatial
def select(scope, hit, mean, est, before, changing):
    g = scope.grid
    a1, a2 = similar_neighbors(g, hit), similar_neighbors(g, hit, step=2)
    class S: pass
    s = S(); s.hit = hit
    alb = mi.Color3f(*AOVS["albedo"].shown(s))
    dr.eval(mean, est, a1, a2, alb)
    cap.update(mean=mean, est=est, a1=a1, a2=a2, alb=alb)
    return mean, remember(before, mean)
F.select = select
params = dict(type="restir_pt", max_depth=study.max_depth, mutations=5, neighbor_sampling="blue_noise", blue_noise="selection")
for k, v in extra.items():
    params[k] = int(v) if v.lstrip("-").isdigit() else (v == "true" if v in ("true", "false") else (float(v) if v.replace(".", "").isdigit() else v))
sensor = rendering.make_sensor(study, scene, size)
place = rendering.make_place(study, scene, sensor)
still = place is None
total = study.warmup + (study.frames - 1) * study.stride + 1
W, H = size
def img(c): return np.stack([np.array(x, dtype=np.float32) for x in c], -1).reshape(H, W, 3)
for c in range(chains):
    it = mi.load_dict(params)
    means, px, ok, flow, a1s, a2s, ests, shown, estf, albs = [], [], [], [], [], [], [], [], [], []
    t = time.time()
    for f in range(total):
        cap.clear()
        if place: place(total - 1 - f)
        seed = rendering.seed_of(study.seed, 7, c, f)
        image = np.array(mi.render(scene, integrator=it, sensor=sensor, spp=1, seed=seed), dtype=np.float32)[..., :3]
        means.append(img(cap["mean"]))
        m = cap["motion"]
        px.append(np.array(m.pixel, dtype=np.int32) + np.zeros(W*H, np.int32)); ok.append(np.array(m.valid) & np.ones(W*H, bool))
        fl = [np.array(x, dtype=np.float32) for x in m.flow]
        flow.append(np.stack([x + np.zeros(W*H, np.float32) for x in fl], -1))
        a1s.append(np.array(cap["a1"])); a2s.append(np.array(cap["a2"]))
        albs.append(img(cap["alb"]).astype(np.float16))
        keepit = f >= study.warmup and (f - study.warmup) % study.stride == 0
        if keepit:
            es = [cap["rounds"][i].estimators for i in range(len(cap["rounds"]))]
            ests.append(np.stack([np.stack([img(c_) for c_ in e.colors]) for e in es]))
            ev = np.stack([np.stack([(np.array(v) & np.ones(W*H, bool)).reshape(H, W) for v in e.valid]) for e in es])
            estf.append(ev); shown.append(image)
    np.savez(f"{out}_{c}.npz", means=np.stack(means), px=np.stack(px), ok=np.stack(ok), flow=np.stack(flow) if not still else np.zeros(1),
             a1=np.stack(a1s), a2=np.stack(a2s), ests=np.stack(ests), valid=np.stack(estf), shown=np.stack(shown), alb=np.stack(albs))
    print(c, round(time.time() - t, 1), "s", flush=True)
