"""real.py STUDY CHAINS SEED0 [param=value...]: shown against plain of the same frames."""
import sys, time

import numpy as np
from selection_probe import load_ref, power
import mitsuba_restir, mitsuba as mi, drjit as dr
from mitsuba_restir.studies.config.files import load_study
from mitsuba_restir.studies.runs.scene import load_scene
from mitsuba_restir.studies.runs import rendering
from mitsuba_restir.integrators import frame as F
from mitsuba_restir.analysis.metrics import hdr_flip
from scipy import stats
name, chains, seed0 = sys.argv[1], int(sys.argv[2]), int(sys.argv[3])
study = load_study(name)
scene = load_scene(study)
store = {}
sel = F.select
def select(scope, hit, rounds, *a):
    store["mean"] = rounds[-1].mean
    out = sel(scope, hit, rounds, *a)
    store["colors"] = out[1].color
    return out
F.select = select
shown_ = F.Shown
def Shown(hit, flow, res, past, cand, first, *a):
    return shown_(hit, flow, res, past - store["colors"] + store["mean"], cand, first, *a)
F.Shown = Shown
def value(v):
    if v in ("true", "false"): return v == "true"
    try: return int(v)
    except ValueError:
        try: return float(v)
        except ValueError: return v
size = (320, 180)
params = dict(type="restir_pt", max_depth=study.max_depth, mutations=5, neighbor_sampling="blue_noise", blue_noise="selection", aovs="history")
flip = True; warm = study.warmup
for kv in sys.argv[4:]:
    k, v = kv.split("=")
    if k == "flip": flip = v == "1"
    elif k == "warm": warm = int(v)
    elif k == "mod": exec(open(v).read())
    else: params[k] = value(v)
if "moving_light" in name: params["retrace_history"] = True
sensor = rendering.make_sensor(study, scene, size)
place = rendering.make_place(study, scene, sensor)
frames, stride = study.frames, study.stride
total = warm + (frames-1)*stride + 1
key = {"blue_noise_ceiling": "ceiling", "blue_noise_whole": "whole"}.get(name, "ajar")
ref = load_ref(key) if "light" not in name else None
rows = []; biases = []
for c in range(chains):
    it = mi.load_dict(params); S, P, b = [], [], []
    t = time.time()
    for f in range(total):
        if place: place(total-1-f)
        x = np.array(mi.render(scene, integrator=it, sensor=sensor, spp=1, seed=rendering.seed_of(study.seed, 9, seed0+c, f)), dtype=np.float32)
        shown, mean = x[..., :3], x[..., 3:6]
        if c == 0 and f == 0: print("channels", x.shape)
        if f >= warm or place:
            b.append((shown.mean(), mean.mean()))
        if f >= warm and (f-warm) % stride == 0:
            S.append(shown); P.append(mean)
    # direct light is in shown but not in mean: take it from where no history matters
    rows.append((S, P, b)); print(c, round(time.time()-t, 1), flush=True) if c == 0 else None
    dr.flush_malloc_cache() if False else None
# emitted light: mean of shown minus mean over pixels is not zero only where lights are seen
out = []
for S, P, b in rows:
    if ref is not None:
        pp, pm, pf = power(P, ref); ps, sm, sf = power(S, ref)
        fl = hdr_flip(S[-1], ref.image)/hdr_flip(P[-1], ref.image) if flip else np.nan
        out.append((ps[1]/pp[1], ps[0]/pp[0], (sm/pm)**.5, sf/pf, fl))
    b = np.array(b); q = b[-13:]
    biases.append((q[:, 0].sum()/q[:, 1].sum()-1, b[-1, 0]/b[-1, 1]-1))
o = np.array(out); b = 100*np.array(biases)
q = stats.t.ppf(.975, max(chains-1, 1))/chains**.5
if len(o):
    print(" ".join(sys.argv[1:]), "| .06-.17 %.3f±%.3f .02-.06 %.3f±%.3f rmse %.3f fmse %.3f flip %.3f" % (o[:, 0].mean(), q*o[:, 0].std(ddof=1), o[:, 1].mean(), q*o[:, 1].std(ddof=1), o[:, 2].mean(), o[:, 3].mean(), o[:, 4].mean()), end=" ")
print("bias all %.2f±%.2f last %.2f±%.2f %%" % (b[:, 0].mean(), q*b[:, 0].std(ddof=1), b[:, 1].mean(), q*b[:, 1].std(ddof=1)), flush=True)
