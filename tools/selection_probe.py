import sys, os, glob, math
import numpy as np
from scipy import ndimage

from mitsuba_restir.analysis import spectrum, metrics
from mitsuba_restir.analysis.images import luminance, smoothed_reference
OFFS = [(x, y) for y in range(-2, 3) for x in range(-2, 3) if 0 < x*x+y*y < 8]
ADJ = [i for i, (x, y) in enumerate(OFFS) if max(abs(x), abs(y)) == 1]
f32 = np.float32
def bits(a, H, W):
    a = a.reshape(H, W)
    return np.stack([((a >> i) & 1).astype(bool) for i in range(20)])
def shifted(P, dx, dy, H, W, r):
    return P[r+dy:r+dy+H, r+dx:r+dx+W]
def wsum(v, w, step=1):
    """sum_i w[i] v(p+off_i); v (H,W[,C]); w (20,H,W)"""
    H, W = v.shape[:2]; r = 2*step
    P = np.pad(v, ((r, r), (r, r)) + ((0, 0),)*(v.ndim-2))
    out = np.zeros_like(v)
    for i, (dx, dy) in enumerate(OFFS):
        s = shifted(P, dx*step, dy*step, H, W, r)
        out += (w[i][..., None] if v.ndim == 3 else w[i]) * s
    return out
def lmean(v, al, step=1, ws=None):
    w = al.astype(f32) if ws is None else al * ws[:, None, None].astype(f32)
    n = 1 + w.sum(0)
    return (v + wsum(v, w, step)) / (n[..., None] if v.ndim == 3 else n)
def weights(sigma):
    return np.array([math.exp(-(x*x+y*y)/(4*sigma**2)) for x, y in OFFS], f32)
class Chain:
    def __init__(self, path):
        d = np.load(path)
        self.means = d["means"]; self.px = d["px"]; self.ok = d["ok"]; self.flow = d["flow"]
        self.F, self.H, self.W = self.means.shape[:3]
        self.a1 = d["a1"]; self.a2 = d["a2"]; self.ests = d["ests"]; self.valid = d["valid"]; self.shown = d["shown"]; self.alb = d["alb"]
        self.n = len(self.ests)
        self.still = self.flow.ndim == 1
        stride = 4
        self.at = [self.F-1-(self.n-1-i)*stride for i in range(self.n)]
    def alike(self, f): return bits(self.a1[f], self.H, self.W)
    def further(self, f): return bits(self.a2[f], self.H, self.W)
    def histories(self, memory=64):
        """package's history, after each measured frame"""
        H, W = self.H, self.W
        col = np.zeros((H*W, 3), f32); n = np.zeros(H*W, f32); out = {}
        for f in range(self.F):
            ok = self.ok[f]
            c0 = np.where(ok[:, None], col[self.px[f]], 0); n0 = np.where(ok, n[self.px[f]], 0)
            n = np.minimum(n0+1, memory)
            col = c0 + (self.means[f].reshape(-1, 3) - c0) * (2/(n+1))[:, None]
            if f in self.at: out[f] = (col.reshape(H, W, 3).copy(), n.reshape(H, W).copy())
        return out
def cands_default(E, V, m):
    """E (k+1,H,W,3), V -> list of (color, valid)"""
    k = V[1:].sum(0).astype(f32); kk = np.maximum(k, 1)[..., None]; tot = E.sum(0)
    out = []
    for g, v in zip(E, V):
        ok = v & (k > 1)
        out += [((tot-g)/kk, ok), (m-(m-g)/kk, ok)]
    return out
def cands_pairs(E, V, m):
    out = cands_default(E, V, m)
    k1 = V.sum(0).astype(f32)
    full = k1 == len(E)
    n = len(E)
    import itertools
    if n == 4:
        for i, j in itertools.combinations(range(4), 2):
            out.append(((E[i]+E[j])/2, full))
    return out
def choose(m, cands, ref, al, sigma=1.0, limit=3.5, rng=None, wanted_scale=1.0, lim=None, tone=None, guard=0.0, ref_lim=None, sweeps=1):
    H, W = m.shape[:2]
    if lim is None:
        lim = limit * lmean(ref if ref_lim is None else ref_lim, al & np.isin(np.arange(20), ADJ)[:, None, None])
    if tone is None:
        err = lambda c: np.clip(c-ref, -lim, lim)
    else:
        err = lambda c: tone(c, ref)
    # stack candidates: errors with inf where invalid
    C = np.stack([m] + [c for c, _ in cands]); ok = np.stack([np.ones((H, W), bool)] + [v for _, v in cands])
    EC = np.stack([err(c) for c in C]).astype(f32)
    w = (al * weights(sigma)[:, None, None]).astype(f32)
    e = EC[0].copy(); pick = np.zeros((H, W), int)
    order = np.random.default_rng(0 if rng is None else rng).permutation(9)
    for s in list(order)*sweeps:
        ox, oy = s % 3, s // 3
        P = np.pad(e, ((2, 4), (2, 4), (0, 0)))
        ny, nx = len(range(oy, H, 3)), len(range(ox, W, 3))
        t = np.zeros((ny, nx, 3), f32)
        for i, (dx, dy) in enumerate(OFFS):
            t -= w[i, oy::3, ox::3, None] * P[oy+dy+2::3, ox+dx+2::3][:ny, :nx]
        ec = EC[:, oy::3, ox::3]
        d = ((ec - t*wanted_scale)**2).sum(-1) + guard*((ec-EC[0:1, oy::3, ox::3])**2).sum(-1)
        d = np.where(ok[:, oy::3, ox::3], d, np.inf)
        b = d.argmin(0)
        e[oy::3, ox::3] = np.take_along_axis(ec, b[None, :, :, None], 0)[0]
        pick[oy::3, ox::3] = b
    return np.take_along_axis(C, pick[None, :, :, None], 0)[0]
class Ref:
    def __init__(self, image, variance):
        from mitsuba_restir.studies.runs.results import ReferenceImage
        self.r = ReferenceImage(image, variance)
def load_ref(scene):
    from mitsuba_restir.studies.config.files import load_study
    from mitsuba_restir.studies.runs import reference as R
    if scene in ("ceiling", "whole"):
        st = load_study("blue_noise_"+scene)
        r = R.read_reference(st)
        return R.smooth(r, st.reference.smooth)
    from mitsuba_restir.studies.runs.results import ReferenceImage
    d = np.load("captured/ref_ajar.npz")
    return ReferenceImage(d["mean"], d["var"])
BANDS = [(0.02, 0.06), (0.06, 0.17)]
def power(frames, ref):
    from mitsuba_restir.studies.measure.frame_errors import relative_errors, reference_noise
    e = relative_errors(np.stack(frames), ref, 4.0)
    p = spectrum.power_spectrum(e) - reference_noise(ref, 4.0, "hann")
    return spectrum.band_power(p, BANDS), (e**2).mean(), np.mean([ndimage.gaussian_filter(x, 1.5)**2 for x in e])
def lum(c): return c @ np.array([0.212671, 0.715160, 0.072169], f32)
def gath(v, valid, idx): return np.where(valid[:, None] if v.ndim == 2 else valid, v[idx], 0)
def catmull(t):
    return np.stack([-.5*t+t*t-.5*t**3, 1-2.5*t*t+1.5*t**3, .5*t+2*t*t-1.5*t**3, -.5*t*t+.5*t**3])
def bspl(t, B=1/3., C=1/3.):
    pass
def taps(chain, f, mode):
    """(offset list, weights (n,HW), valid (n,HW)) around px for frame f; relative to px."""
    H, W = chain.H, chain.W
    ok, px = chain.ok[f], chain.px[f]
    fl = chain.flow[f].reshape(-1, 2)
    y, x = np.mgrid[:H, :W]
    sx = x.ravel() + .5 + fl[:, 0]; sy = y.ravel() + .5 + fl[:, 1]   # position in previous frame
    ax, ay = px % W, px // W
    al = bits(chain.a1[f-1], H, W).reshape(20, -1)
    out = []
    if mode == "bilinear": n, lo = 2, 0
    else: n, lo = 4, -1
    bx, by = np.floor(sx-.5).astype(int), np.floor(sy-.5).astype(int)
    tx, ty = sx-.5-bx, sy-.5-by
    wx = np.stack([1-tx, tx]) if mode == "bilinear" else catmull(tx)
    wy = np.stack([1-ty, ty]) if mode == "bilinear" else catmull(ty)
    tot = 0; idxs, ws = [], []
    for j in range(n):
        for i in range(n):
            dx, dy = bx+lo+i-ax, by+lo+j-ay
            good = ok.copy()
            near = (dx == 0) & (dy == 0)
            v = near.copy()
            for b, (ox, oy) in enumerate(OFFS):
                m = (dx == ox) & (dy == oy)
                if m.any(): v |= m & al[b][px]
            good &= v
            idx = np.where(good, (ay+dy)*W+ax+dx, 0)
            w = wx[i]*wy[j]*good
            idxs.append(idx); ws.append(w.astype(f32))
    return np.stack(idxs), np.stack(ws)
def reproj(chain, f, mode, col, n):
    """history colour, count at pixels of frame f from previous arrays (HW,3),(HW)"""
    ok, px = chain.ok[f], chain.px[f]
    n0 = np.where(ok, n[px], 0)
    near = np.where(ok[:, None], col[px], 0)
    if mode == "nearest" or chain.still or f == 0: return near, n0
    idx, w = taps(chain, f, mode)
    tot = w.sum(0)
    c = (col[idx]*w[..., None]).sum(0)
    good = tot > 0.5
    c = np.where(good[:, None], c/np.where(good, tot, 1)[:, None], near)
    if mode == "catmull":
        lo = np.where(w[..., None] != 0, col[idx], np.inf).min(0); hi = np.where(w[..., None] != 0, col[idx], -np.inf).max(0)
        c = np.where(good[:, None], np.clip(c, lo, hi), c)
    return c.astype(f32), n0
def history(chain, mode="nearest", memory=64, pre=None):
    H, W = chain.H, chain.W
    col = np.zeros((H*W, 3), f32); n = np.zeros(H*W, f32); sq = np.zeros(H*W, f32); out = {}
    for f in range(chain.F):
        m = chain.means[f].reshape(-1, 3)
        c0, n0 = reproj(chain, f, mode, np.c_[col, sq], n)
        c0, s0 = c0[:, :3], c0[:, 3]
        n = np.minimum(n0+1, memory); a = (2/(n+1))
        col = c0 + (m-c0)*a[:, None]
        sq = s0 + (lum(m)**2 - s0)*a
        if f in chain.at: out[f] = (col.reshape(H, W, 3).copy(), n.reshape(H, W).copy(), sq.reshape(H, W).copy())
    return out
def load(name, n):
    return [Chain(f"captured/{name}_{i}.npz") for i in range(n)]
def alb_history(chain, memory=64):
    """running mean albedo alongside (same reprojection)"""
    H, W = chain.H, chain.W
    col = np.zeros((H*W, 3), f32); n = np.zeros(H*W, f32); out = {}
    for f in range(chain.F):
        m = chain.alb[f].astype(f32).reshape(-1, 3)
        ok = chain.ok[f]
        c0 = np.where(ok[:, None], col[chain.px[f]], 0); n0 = np.where(ok, n[chain.px[f]], 0)
        n = np.minimum(n0+1, memory)
        col = c0 + (m-c0)*(2/(n+1))[:, None]
        if f in chain.at: out[f] = col.reshape(H, W, 3).copy()
    return out
def bilateral(v, al, step, sd, k, wd=None):
    """range weights exp(-|dl|/(k sd_p)); returns filtered v; sd (H,W)"""
    H, W = v.shape[:2]; r = 2*step
    l = lum(v)
    P = np.pad(v, ((r, r), (r, r), (0, 0))); Pl = np.pad(l, r); 
    num = v.copy(); den = np.ones((H, W), f32)
    for i, (dx, dy) in enumerate(OFFS):
        w = al[i] * np.exp(-np.abs(shifted(Pl, dx*step, dy*step, H, W, r) - l)/(k*sd + 1e-6))
        if wd is not None: w = w*wd[i]
        num += w[..., None]*shifted(P, dx*step, dy*step, H, W, r); den += w
    return num/den[..., None]
def evaluate(chains, ref, refs_of, cands=cands_default, direct=True, **kw):
    """power ratio of selection with reference refs_of(chain, f, hist) to plain, per chain"""
    ratios, bias, rr, fm = [], [], [], []
    part = []
    for c in chains:
        plain, shown, r_ = [], [], []
        for i, f in enumerate(c.at):
            m = c.means[f]; al = c.alike(f)
            r = refs_of(c, f, i)
            d = c.shown[i]-m
            E, V = c.ests[i][-1], c.valid[i][-1]
            s = choose(m, cands(E, V, m), r, al, rng=f, **kw)
            plain.append(m+d); shown.append(s+d); r_.append(r+d)
        pp, pm, pf = power(plain, ref); ps, sm, sf = power(shown, ref); pr, _, rf = power(r_, ref)
        ratios.append((ps[1]/pp[1], ps[0]/pp[0], pr[1]/pp[1], (sm/pm)**.5, sf/pf))
        bias.append(np.mean(shown)/np.mean(plain)-1)
        hh = np.mean([c.hist[f][0] for f in c.at]); mm = np.mean(plain); dd = np.mean([c.shown[i]-c.means[f] for i, f in enumerate(c.at)])
        part.append([(np.mean(shown)-np.mean(r_))/mm, (np.mean(r_)-dd-hh)/mm, (hh+dd)/mm-1])
    return np.mean(ratios, 0), np.std(ratios, 0)/max(len(chains)-1, 1)**.5, np.mean(bias), np.std(bias)/max(len(chains)-1, 1)**.5, np.mean(part, 0), np.std(part, 0)/max(len(chains)-1, 1)**.5
def show(name, res):
    r, s, b, bs, pt, ps = res
    print(f"{name:40s} .06-.17 {r[0]:.3f}±{s[0]:.3f}  .02-.06 {r[1]:.3f}  ref {r[2]:.3f}  rmse {r[3]:.3f} fmse {r[4]:.3f} bias {100*b:+.2f}±{100*bs:.2f} % [s-r {100*pt[0]:+.2f}±{100*ps[0]:.2f} r-h {100*pt[1]:+.2f}±{100*ps[1]:.2f} h-m {100*pt[2]:+.2f}]", flush=True)

# --------------------------------- cases

scene, n = sys.argv[1], int(sys.argv[2])
ref = load_ref(scene); chains = load(scene, n)
for c in chains:
    c.hist = history(c)
    if scene == "ajar": c.albh = alb_history(c)
def H0(c, f, i): return c.hist[f][0]
def L1(c, f, i): return lmean(H0(c, f, i), c.alike(f))
def L2(c, f, i): return lmean(L1(c, f, i), c.further(f), 2)
def B(k, steps):
    def g(c, f, i):
        col, n, sq = c.hist[f]
        r = col
        var = np.maximum(sq-lum(col)**2, 0)*2/(n+1)   # of the mean, were frames independent
        sd = np.sqrt(lmean(var, c.alike(f)))
        for s in steps:
            r = bilateral(r, c.alike(f) if s == 1 else c.further(f), s, sd, k)
        return r
    return g
def ratio_filter(r, al, step, g, guide=None):
    H, W = r.shape[:2]; R = 2*step
    l = lum(r) if guide is None else guide
    P = np.pad(r, ((R, R), (R, R), (0, 0))); Pl = np.pad(l, R); num = r.copy(); den = np.ones((H, W), f32)
    for i, (dx, dy) in enumerate(OFFS):
        q = shifted(Pl, dx*step, dy*step, H, W, R)
        w = al[i]*(np.minimum(l, q)/(np.maximum(l, q)+1e-9))**g
        num += w[..., None]*shifted(P, dx*step, dy*step, H, W, R); den += w
    return num/den[..., None]
def RF(g, steps=(1, 2)):
    def fn(c, f, i):
        r = c.hist[f][0]
        for s in steps: r = ratio_filter(r, c.alike(f) if s == 1 else c.further(f), s, g)
        return r
    return fn
def DM(fn):
    """demodulated by albedo"""
    def g(c, f, i):
        a = c.albh[f]+.02
        old = c.hist[f]; c.hist[f] = (old[0]/a, old[1], None if old[2] is None else old[2]/lum(a)**2)+tuple(old[3:])
        r = fn(c, f, i)*a
        c.hist[f] = old
        return r
    return g
T = ref.image.astype(f32)
if __name__ == "__main__":
    show("today", evaluate(chains, ref, H0))
    show("oracle", evaluate(chains, ref, lambda c, f, i: T-(c.shown[i]-c.means[f])))
    show("oracle pairs", evaluate(chains, ref, lambda c, f, i: T-(c.shown[i]-c.means[f]), cands=cands_pairs))
    show("today pairs", evaluate(chains, ref, H0, cands=cands_pairs))
    show("L2 pairs", evaluate(chains, ref, L2, cands=cands_pairs))
    for k in (2, 4, 8): show(f"B {k} 1,2 pairs", evaluate(chains, ref, B(k, (1, 2)), cands=cands_pairs))
    for g in (1, 2, 4): show(f"ratio {g} 1,2 pairs", evaluate(chains, ref, RF(g), cands=cands_pairs))
    if scene == "ajar":
        for g in (1, 2): show(f"demod ratio {g} 1,2 pairs", evaluate(chains, ref, DM(RF(g)), cands=cands_pairs))
        show(f"demod L2", evaluate(chains, ref, DM(L2), cands=cands_pairs))
        show(f"demod B4", evaluate(chains, ref, DM(B(4, (1,2))), cands=cands_pairs))
# the variants of reprojection, of weights, of candidates and of clipped averages
# ---- cam.py
# import sys
# sys.argv = ["e4.py", "camera"] + sys.argv[1:]
# from e4 import *
# P = dict(cands=cands_pairs)
# c = chains[0]
# print("valid", [round(float(c.ok[f].mean()), 3) for f in (1, 5, 15, 30)], "flow", np.abs(c.flow[-1]).mean(0), np.abs(c.flow[-1]).max(0))
# def report(nm, mode):
#     for c in chains: c.hist = history(c, mode)
#     show(f"{nm} H0 default cands", evaluate(chains, ref, H0))
#     for k, fn in (("H0", H0), ("R2", RF(2)), ("R4", RF(4))):
#         show(f"{nm} {k} pairs", evaluate(chains, ref, fn, **P))
# report("nearest", "nearest")
# report("bilinear", "bilinear")
# report("catmull", "catmull")
# show("oracle pairs", evaluate(chains, ref, lambda c, f, i: T-(c.shown[i]-c.means[f]), **P))
# print("frames", [np.mean(c.hist[c.at[-1]][1]) for c in chains[:2]], [np.mean(c.hist[c.at[-1]][1] < 4) for c in chains[:2]])
# ---- cam2.py
# import sys
# sys.argv = ["e4.py", "camera"] + sys.argv[1:]
# from e4 import *
# P = dict(cands=cands_pairs)
# def hist2(chain, mode="catmull", memory=64, clamp=None, lin=True):
#     H, W = chain.H, chain.W
#     col = np.zeros((H*W, 3), f32); n = np.zeros(H*W, f32); out = {}; D = []
#     for f in range(chain.F):
#         m = chain.means[f].reshape(-1, 3)
#         c0, n0 = reproj(chain, f, mode, col, n)
#         c0 = c0[:, :3]
#         if clamp is not None:
#             al = chain.alike(f); mm = chain.means[f]
#             ce = lmean(mm, al); sq = lmean(mm*mm, al); sd = np.sqrt(np.maximum(sq-ce*ce, 0))
#             c0 = np.where(n0[:, None] > 0, np.clip(c0, (ce-clamp*sd).reshape(-1, 3), (ce+clamp*sd).reshape(-1, 3)), 0).astype(f32)
#         n = np.minimum(n0+1, memory)
#         a = 2/(n+1) if lin else 1/n
#         col = c0 + (m-c0)*a[:, None]
#         if f > 15: D.append(((c0-m)[n0 > 0].mean(), m.mean(), ))
#         if f in chain.at: out[f] = (col.reshape(H, W, 3).copy(), n.reshape(H, W).copy(), None)
#     d = np.array(D); chain.hm = d[:, 0].mean()/d[:, 1].mean()
#     return out
# def report(nm, fn=RF(2), **kw):
#     for c in chains: c.hist = hist2(c, **kw)
#     h = [c.hm for c in chains]
#     print("history - frame where there is one: %.2f±%.2f %%" % (100*np.mean(h), 100*np.std(h)/len(h)**.5))
#     show(nm, evaluate(chains, ref, fn, **P))
# report("nearest", mode="nearest")
# report("catmull")
# report("catmull mem 16", memory=16)
# report("catmull mem 8", memory=8)
# report("catmull clamp 1", clamp=1)
# report("catmull clamp 2", clamp=2)
# report("catmull 1/n", lin=False)
# ---- bv.py
# from e4 import *
# from mitsuba_restir.studies.measure.frame_errors import relative_errors
# def var_of(c, f, floor=.05):
#     col, n, sq = c.hist[f][:3]
#     l = lum(col)
#     return np.maximum(sq-l**2, 0)*2/(n+1) + (floor*l)**2 + 1e-12
# def bv(r, var, al, step, k, prec=1.0):
#     H, W = r.shape[:2]; R = 2*step; l = lum(r)
#     pad = lambda x: np.pad(x, ((R, R), (R, R))+((0, 0),)*(x.ndim-2))
#     Pr, Pl, Pv = pad(r), pad(l), np.pad(var, R, constant_values=1)
#     w0 = var**-prec; num = r*w0[..., None]; den = w0.copy(); nv = var*w0**2
#     for i, (dx, dy) in enumerate(OFFS):
#         q = shifted(Pl, dx*step, dy*step, H, W, R); v = shifted(Pv, dx*step, dy*step, H, W, R)
#         w = al[i]*np.exp(-(l-q)**2/(2*k*k*(var+v)))*v**-prec
#         num += w[..., None]*shifted(Pr, dx*step, dy*step, H, W, R); den += w; nv += w*w*v
#     return num/den[..., None], nv/den**2
# def BV(k, steps=(1, 2), prec=1.0, floor=.05, upd=False):
#     def fn(c, f, i):
#         r, v = c.hist[f][0], var_of(c, f, floor)
#         for s in steps:
#             r, nv = bv(r, v, c.alike(f) if s == 1 else c.further(f), s, k, prec)
#             if upd: v = nv
#         return r
#     return fn
# def stats(name, fn, c, f):
#     e = relative_errors((fn(c, f, c.at.index(f))+c.shown[c.at.index(f)]-c.means[f])[None], ref, None)[0]
#     print(name, "ref power by clip 4,2,1,.5", np.round([spectrum.band_power(spectrum.power_spectrum(np.clip(e, -k, k)), BANDS)[1] for k in (4, 2, 1, .5)], 4), "rms", np.round([np.mean(np.clip(e, -k, k)**2)**.5 for k in (4, 1)], 3), flush=True)
# if __name__ == "__main__":
#     c = chains[0]; f = c.at[0]
#     stats("H0", H0, c, f); stats("R4", RF(4), c, f)
#     for k in (.5, 1, 2, 4):
#         for prec in (0, .5, 1):
#             stats(f"BV {k} prec {prec}", BV(k, prec=prec), c, f)
#     for k in (1, 2): 
#         for fl in (.02, .1, .2): stats(f"BV {k} prec .5 floor {fl}", BV(k, prec=.5, floor=fl), c, f)
#         stats(f"BV {k} prec .5 step1", BV(k, (1,), .5), c, f)
#         stats(f"BV {k} prec .5 upd", BV(k, prec=.5, upd=True), c, f)
# ---- e7.py
# from e4 import *
# for c in chains: c.albh = alb_history(c)
# P = dict(cands=cands_pairs)
# def chist(chain, lim=4, memory=64, first=4):
#     """history of averages clipped at lim times the local mean of what is known"""
#     H, W = chain.H, chain.W
#     col = np.zeros((H*W, 3), f32); n = np.zeros(H*W, f32); ov = np.zeros((H*W, 3), f32); out = {}
#     for f in range(chain.F):
#         ok = chain.ok[f]; px = chain.px[f]
#         c0 = np.where(ok[:, None], col[px], 0); n0 = np.where(ok, n[px], 0); o0 = np.where(ok[:, None], ov[px], 0)
#         m = chain.means[f].reshape(-1, 3)
#         al = chain.alike(f)
#         nn = np.minimum(n0+1, memory); a = (2/(nn+1))[:, None]
#         base = lmean((c0*n0[:, None]).reshape(H, W, 3), al)/np.maximum(lmean(n0.reshape(H, W), al), 1e-6)[..., None]
#         base = np.where((n0 >= first)[:, None], base.reshape(-1, 3), np.inf)
#         mc = np.minimum(m, lim*base)
#         col = c0+(mc-c0)*a; ov = o0+(m-mc-o0)*a; n = nn
#         if f in chain.at: out[f] = (col.reshape(H, W, 3).copy(), n.reshape(H, W).copy(), None, ov.reshape(H, W, 3).copy())
#     return out
# def with_hist(fn, key="ch", spread=True, demod=False):
#     def g(c, f, i):
#         old = c.hist; c.hist = getattr(c, key)
#         r = fn(c, f, i)
#         if spread:
#             o = c.hist[f][3]; o = lmean(lmean(o, c.alike(f)), c.further(f), 2)
#             r = r+o
#         c.hist = old
#         return r
#     return g
# for lim in () if "e10" in sys.argv[0] else (2, 4):
#     for c in chains: c.ch = chist(c, lim)
#     for nm, fn in (("H0", H0), ("R2", RF(2)), ("R4", RF(4)), ("D2", DM(RF(2)))):
#         show(f"{scene} clip {lim} {nm}", evaluate(chains, ref, with_hist(fn), **P))
# ---- e8.py
# from e4 import *
# from mitsuba_restir.studies.measure.frame_errors import relative_errors
# O = lambda c, f, i: T-(c.shown[i]-c.means[f])
# def singles(E, V, m):
#     out = cands_pairs(E, V, m)
#     for g, v in zip(E, V): out.append((g, v & (V.sum(0) > 1)))
#     return out
# def plus_half(E, V, m):
#     out = cands_pairs(E, V, m); out.append((m/2, np.ones(m.shape[:2], bool))); return out
# def more(E, V, m):
#     """also where fewer pairs"""
#     out = singles(E, V, m)
#     return out
# c = chains[0]; f = c.at[0]
# V = c.valid[0][-1]; print("number of estimators", np.bincount(V.sum(0).ravel())/V[0].size)
# m = c.means[f]; d = c.shown[0]-m
# E_ = c.ests[0][-1]
# def stats(name, img):
#     e = relative_errors((img+d)[None], ref, None)[0]
#     row = []
#     for clip in (4, 2, 1, .5):
#         p = spectrum.band_power(spectrum.power_spectrum(np.clip(e, -clip, clip)), BANDS)
#         row.append(p[1])
#     print(name, "power by clip 4,2,1,.5", np.round(row, 4), "share |e|>1", np.mean(np.abs(e) > 1), ">4", np.mean(np.abs(e) > 4), "black", np.mean(img.sum(-1) == 0))
# stats("plain", m)
# for nm, cs in (("default", cands_default), ("pairs", cands_pairs), ("singles", singles), ("half", plus_half)):
#     s = choose(m, cs(E_, V, m), O(c, f, 0), c.alike(f), rng=f)
#     stats("oracle "+nm, s)
# s = choose(m, cands_pairs(E_, V, m), O(c, f, 0), c.alike(f), rng=f, limit=1e3); stats("oracle pairs no limit", s)
# s = choose(m, cands_pairs(E_, V, m), O(c, f, 0), np.ones_like(c.alike(f)), rng=f); stats("oracle pairs all alike", s)
# s = choose(m, singles(E_, V, m), O(c, f, 0), np.ones_like(c.alike(f)), rng=f, limit=1e3); stats("oracle singles all alike nolimit", s)
# ---- e9.py
# from e4 import *
# O = lambda c, f, i: T-(c.shown[i]-c.means[f])
# def singles(E, V, m):
#     out = cands_pairs(E, V, m)
#     for g, v in zip(E, V): out.append((g, v & (V.sum(0) > 1)))
#     return out
# unlit = np.random.default_rng(5).random(T.shape[:2]) < (.85 if scene == "whole" else .7)
# def half(E, V, m): return cands_pairs(E, V, m)+[(m/2, unlit)]
# def quarter(E, V, m): return cands_pairs(E, V, m)+[(m/2, unlit), (m*.75, unlit)]
# def zero(E, V, m): return cands_pairs(E, V, m)+[(m/2, unlit), (m*0, unlit)]
# def szero(E, V, m): return singles(E, V, m)+[(m/2, unlit), (m*0, unlit)]
# def dzero(E, V, m): return cands_default(E, V, m)+[(m/2, unlit), (m*0, unlit)]
# R = RF(4)
# for nm, cs in (("pairs", cands_pairs), ("singles", singles), ("half", half), ("zero", zero), ("szero", szero), ("dzero", dzero)):
#     show(f"{scene} O {nm}", evaluate(chains, ref, O, cands=cs))
#     show(f"{scene} R4 {nm}", evaluate(chains, ref, R, cands=cs))
# ---- e11.py
# import sys
# scene = sys.argv[1]
# from e4 import *
# P = dict(cands=cands_pairs)
# if scene == "camera":
#     for c in chains: c.hist = history(c, "catmull")
# for kw in (dict(), dict(sigma=.8), dict(sigma=1.3), dict(limit=2), dict(limit=6)):
#     show(f"{scene} R4 pairs {kw}", evaluate(chains, ref, RF(4), **P, **kw))
# def RN(g, steps=(1, 2)):
#     """weighted by the frames known"""
#     def fn(c, f, i):
#         r, n = c.hist[f][0], c.hist[f][1]
#         for s in steps:
#             al = c.alike(f) if s == 1 else c.further(f)
#             H, W = n.shape; R = 2*s; l = lum(r); pad = lambda x: np.pad(x, ((R, R), (R, R))+((0, 0),)*(x.ndim-2))
#             Pr, Pl, Pn = pad(r), pad(l), pad(n); num = r*n[..., None]; den = n.copy()
#             for k, (dx, dy) in enumerate(OFFS):
#                 q = shifted(Pl, dx*s, dy*s, H, W, R)
#                 w = al[k]*(np.minimum(l, q)/(np.maximum(l, q)+1e-9))**g*shifted(Pn, dx*s, dy*s, H, W, R)
#                 num += w[..., None]*shifted(Pr, dx*s, dy*s, H, W, R); den += w
#             r = num/den[..., None]
#         return r
#     return fn
# show(f"{scene} RN4", evaluate(chains, ref, RN(4), **P))
# show(f"{scene} RN2", evaluate(chains, ref, RN(2), **P))
# show(f"{scene} R3", evaluate(chains, ref, RF(3), **P))
# show(f"{scene} R4 1,2,1", evaluate(chains, ref, RF(4, (1, 2, 1)), **P))
# show(f"{scene} R4 1 only", evaluate(chains, ref, RF(4, (1,)), **P))
# show(f"{scene} R4 1,1", evaluate(chains, ref, RF(4, (1,1)), **P))
# show(f"{scene} R4 2,1", evaluate(chains, ref, RF(4, (2,1)), **P))
# ---- e12.py
# import sys
# sys.argv = ["e12", "raw", "1"]
# import sim
# lr = sim.load_ref
# sim.load_ref = lambda s: lr("whole")
# import e4; from e4 import *
# def rounds_c(c, f, i):
#     E1, V1 = c.ests[i][0], c.valid[i][0]
#     return E1, V1
# c = chains[0]
# print(c.ests.shape)
# fn = RF(4)
# res = {}
# for nm in ("default", "pairs", "both half", "both half singles", "round 1 pairs half"):
#     plain, shown = [], []
#     for i, f in enumerate(c.at):
#         m = c.means[f]; al = c.alike(f); r = fn(c, f, i); d = c.shown[i]-m
#         E, V = c.ests[i][-1], c.valid[i][-1]; E1, V1 = c.ests[i][0], c.valid[i][0]
#         m1 = E1.sum(0)/V1.sum(0)[..., None]
#         cs = cands_default(E, V, m) if nm == "default" else cands_pairs(E, V, m)
#         if nm == "both half": cs += [((m+x)/2, v) for x, v in cands_default(E1, V1, m1)] + [((m+m1)/2, np.ones(m.shape[:2], bool))]
#         if nm == "round 1 pairs half": cs += [((m+x)/2, v) for x, v in cands_pairs(E1, V1, m1)] + [((m+m1)/2, np.ones(m.shape[:2], bool))]
#         if nm == "both half singles": cs += [(x, v) for x, v in cands_default(E1, V1, m1)]
#         s = choose(m, cs, r, al, rng=f)
#         plain.append(m+d); shown.append(s+d)
#     pp, pm, pf = power(plain, ref); ps, sm, sf = power(shown, ref)
#     print(nm, "%.3f %.3f rmse %.3f fmse %.3f bias %.2f %%" % (ps[1]/pp[1], ps[0]/pp[0], (sm/pm)**.5, sf/pf, 100*(np.mean(shown)/np.mean(plain)-1)), flush=True)
