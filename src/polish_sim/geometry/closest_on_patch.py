"""Closest point on one quadratic Bezier triangle, exact (point -> barycentric coordinates)."""

from __future__ import annotations

import numpy as np

from polish_sim.kernels import Triple, Vector, dot, kernel, minus, part, plus, scaled

_STEPS = 24
_STEP_DONE = 1e-13
_NEWTON_DONE = 1e-8  # the next step would be of the order of its square


@part
def closest_on_patch(patch, point):  # type: ignore[no-untyped-def]
    """Closest point of one patch (6, 3) to a point [m]: squared distance [m^2] and barycentric coordinates
    u, v.

    Newton's method on the whole quadratic first; where it ends outside the triangle, the three edges.
    """
    u, v, settled = _newton(patch, point)
    w = 1.0 - u - v
    if settled and u >= 0.0 and v >= 0.0 and w >= 0.0:
        return _distance2(patch, u, v, point), u, v
    best, best_u, best_v = np.inf, 0.0, 0.0
    for edge in range(3):
        # The closest point lies on an edge that the stationary point is beyond.
        beyond = w if edge == 0 else (u if edge == 1 else v)
        if settled and beyond > 0.0:
            continue
        t, distance2 = _closest_on_edge(patch, edge, point)
        if distance2 < best:
            best = distance2
            best_u, best_v = on_edge(edge, t)
    return best, best_u, best_v


@part
def on_edge(edge, t):  # type: ignore[no-untyped-def]
    """Barycentric u, v of a point on an edge, t from its first corner."""
    if edge == 0:
        return 1.0 - t, t
    if edge == 1:
        return 0.0, 1.0 - t
    return t, 0.0


@part
def blossom(patch, u, v, w):  # type: ignore[no-untyped-def]
    """Points a, b, c: a patch's point is u a + v b + w c, its derivatives are 2 (a - c) and 2 (b - c)."""
    p0, p1, p2, p3, p4, p5 = patch[0], patch[1], patch[2], patch[3], patch[4], patch[5]
    return (
        weighted(u, p0, v, p3, w, p5),
        weighted(u, p3, v, p1, w, p4),
        weighted(u, p5, v, p4, w, p2),
    )


@kernel
def weighted(u: float, a: Vector, v: float, b: Vector, w: float, c: Vector) -> Triple:
    """u a + v b + w c."""
    return plus(plus(scaled(u, a), scaled(v, b)), scaled(w, c))  # type: ignore[no-any-return]


@part
def _newton(patch, point):  # type: ignore[no-untyped-def]
    """Stationary point u, v of the distance to the patch continued beyond its edges, and whether it is a
    minimum."""
    p0, p1, p2, p3, p4, p5 = patch[0], patch[1], patch[2], patch[3], patch[4], patch[5]
    eu, ev, away = minus(p0, p2), minus(p1, p2), minus(point, p2)
    guu, guv, gvv = dot(eu, eu), dot(eu, ev), dot(ev, ev)
    ru, rv = dot(eu, away), dot(ev, away)
    det = guu * gvv - guv * guv
    if det <= 1e-28 * guu * gvv:
        return 0.0, 0.0, False
    # Start from the foot on the flat triangle, kept near it.
    u = min(max((gvv * ru - guv * rv) / det, -0.2), 1.2)
    v = min(max((guu * rv - guv * ru) / det, -0.2), 1.2)
    settled = False
    bend_u, bend_v = plus(minus(p0, scaled(2.0, p5)), p2), plus(minus(p1, scaled(2.0, p4)), p2)
    bend_uv = plus(minus(minus(p3, p5), p4), p2)
    for _ in range(_STEPS):
        w = 1.0 - u - v
        a, b, c = blossom(patch, u, v, w)
        r = minus(weighted(u, a, v, b, w, c), point)
        du, dv = scaled(2.0, minus(a, c)), scaled(2.0, minus(b, c))
        fu, fv = dot(r, du), dot(r, dv)
        huu, huv, hvv = dot(du, du), dot(du, dv), dot(dv, dv)
        twice = scaled(2.0, r)
        quu = dot(twice, bend_u)
        quv = dot(twice, bend_uv)
        qvv = dot(twice, bend_v)
        suu, suv, svv = huu + quu, huv + quv, hvv + qvv
        det = suu * svv - suv * suv
        convex = suu > 0.0 and det > 1e-6 * huu * hvv
        if not convex:
            # The Gauss-Newton step goes downhill.
            suu, suv, svv = huu, huv, hvv
            det = suu * svv - suv * suv
            if det <= 1e-28 * huu * hvv:
                return u, v, False
        su, sv = (svv * fu - suv * fv) / det, (suu * fv - suv * fu) / det
        size = max(abs(su), abs(sv))
        if size > 0.5:
            su, sv = 0.5 * su / size, 0.5 * sv / size
        u -= su
        v -= sv
        if size < (_NEWTON_DONE if convex else _STEP_DONE):
            settled = convex
            break
        if u < -1.0 or v < -1.0 or u + v > 2.0:
            break
    return u, v, settled


@part
def _distance2(patch, u, v, point):  # type: ignore[no-untyped-def]
    w = 1.0 - u - v
    total = 0.0
    for k in range(3):
        r = (
            u * u * patch[0, k]
            + v * v * patch[1, k]
            + w * w * patch[2, k]
            + 2.0 * (u * v * patch[3, k] + v * w * patch[4, k] + w * u * patch[5, k])
            - point[k]
        )
        total += r * r
    return total


@part
def _closest_on_edge(patch, edge, point):  # type: ignore[no-untyped-def]
    """Closest point of an edge: its parameter from corner ``edge`` on, and the squared distance."""
    last = (edge + 1) % 3
    # |c0 + c1 t + c2 t^2|^2 as a polynomial of degree four in t.
    q0 = q1 = q2 = q3 = q4 = 0.0
    for k in range(3):
        c0 = patch[edge, k] - point[k]
        c1 = 2.0 * (patch[3 + edge, k] - patch[edge, k])
        c2 = patch[edge, k] - 2.0 * patch[3 + edge, k] + patch[last, k]
        q0 += c0 * c0
        q1 += 2.0 * c0 * c1
        q2 += c1 * c1 + 2.0 * c0 * c2
        q3 += 2.0 * c1 * c2
        q4 += c2 * c2
    best_t, best = 0.0, np.inf
    for i in range(5):
        t = 0.25 * i
        value = q0 + t * (q1 + t * (q2 + t * (q3 + t * q4)))
        if value < best:
            best, best_t = value, t
    t = best_t
    low, high = max(t - 0.25, 0.0), min(t + 0.25, 1.0)
    for _ in range(_STEPS):
        slope = q1 + t * (2.0 * q2 + t * (3.0 * q3 + t * 4.0 * q4))
        bend = 2.0 * q2 + t * (6.0 * q3 + t * 12.0 * q4)
        if slope > 0.0:
            high = t
        else:
            low = t
        step = t - slope / bend if bend > 0.0 else -1.0
        # A bound that is the minimum itself must not be left again by rounding.
        inside = low - _STEP_DONE < step < high + _STEP_DONE
        moved = min(max(step, low), high) if inside else 0.5 * (low + high)
        if step <= low and low == 0.0 and slope > 0.0:
            moved = 0.0
        if step >= high and high == 1.0 and slope < 0.0:
            moved = 1.0
        done = abs(moved - t) < _STEP_DONE
        t = moved
        if done:
            break
    total = 0.0
    s = 1.0 - t
    for k in range(3):
        r = s * s * patch[edge, k] + 2.0 * s * t * patch[3 + edge, k] + t * t * patch[last, k] - point[k]
        total += r * r
    return t, total


@part
def flat_distance2(patch, point):  # type: ignore[no-untyped-def]
    """Squared distance to the flat triangle of a patch's corners [m^2]."""
    a, b, p = minus(patch[0], patch[2]), minus(patch[1], patch[2]), minus(point, patch[2])
    aa, ab, bb = dot(a, a), dot(a, b), dot(b, b)
    pa, pb, pp = dot(p, a), dot(p, b), dot(p, p)
    det = aa * bb - ab * ab
    u, v = bb * pa - ab * pb, aa * pb - ab * pa
    if u >= 0.0 and v >= 0.0 and u + v <= det and det > 0.0:
        u, v = u / det, v / det
        return max(pp - u * pa - v * pb, 0.0)
    # Beyond an edge: the nearest point of the three edges.
    t = min(max(pa / aa, 0.0), 1.0)
    best = pp + t * (t * aa - 2.0 * pa)
    t = min(max(pb / bb, 0.0), 1.0)
    best = min(best, pp + t * (t * bb - 2.0 * pb))
    cc, pc = aa - 2.0 * ab + bb, pb - pa + aa - ab
    t = min(max(pc / cc, 0.0), 1.0)
    return max(min(best, pp - 2.0 * pa + aa + t * (t * cc - 2.0 * pc)), 0.0)
