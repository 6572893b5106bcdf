"""Closest point on one quadratic Bezier triangle, exact (point -> barycentric coordinates)."""

from __future__ import annotations

import numpy as np

from polish_sim.kernel_cache import njit

_STEPS = 24
_STEP_DONE = 1e-13
_NEWTON_DONE = 1e-8  # the next step would be of the order of its square


@njit
def closest_on_patch(patch, x, y, z):  # type: ignore[no-untyped-def]
    """Closest point of one patch (6, 3) to (x, y, z) [m]: squared distance [m^2] and barycentric coordinates
    u, v.

    Newton's method on the whole quadratic first; where it ends outside the triangle, the three edges.
    """
    u, v, settled = _newton(patch, x, y, z)
    w = 1.0 - u - v
    if settled and u >= 0.0 and v >= 0.0 and w >= 0.0:
        return _distance2(patch, u, v, x, y, z), u, v
    best, best_u, best_v = np.inf, 0.0, 0.0
    for edge in range(3):
        # The closest point lies on an edge that the stationary point is beyond.
        beyond = w if edge == 0 else (u if edge == 1 else v)
        if settled and beyond > 0.0:
            continue
        t, distance2 = _closest_on_edge(patch, edge, x, y, z)
        if distance2 < best:
            best = distance2
            best_u, best_v = on_edge(edge, t)
    return best, best_u, best_v


@njit
def on_edge(edge, t):  # type: ignore[no-untyped-def]
    """Barycentric u, v of a point on an edge, t from its first corner."""
    if edge == 0:
        return 1.0 - t, t
    if edge == 1:
        return 0.0, 1.0 - t
    return t, 0.0


@njit
def _newton(patch, x, y, z):  # type: ignore[no-untyped-def]
    """Stationary point u, v of the distance to the patch continued beyond its edges, and whether it is a
    minimum."""
    guu = guv = gvv = 0.0
    ru = rv = 0.0
    for k in range(3):
        q = x if k == 0 else (y if k == 1 else z)
        eu, ev = patch[0, k] - patch[2, k], patch[1, k] - patch[2, k]
        guu += eu * eu
        guv += eu * ev
        gvv += ev * ev
        ru += eu * (q - patch[2, k])
        rv += ev * (q - patch[2, k])
    det = guu * gvv - guv * guv
    if det <= 1e-28 * guu * gvv:
        return 0.0, 0.0, False
    # Start from the foot on the flat triangle, kept near it.
    u = min(max((gvv * ru - guv * rv) / det, -0.2), 1.2)
    v = min(max((guu * rv - guv * ru) / det, -0.2), 1.2)
    settled = False
    for _ in range(_STEPS):
        w = 1.0 - u - v
        fu = fv = huu = huv = hvv = quu = quv = qvv = 0.0
        for k in range(3):
            q = x if k == 0 else (y if k == 1 else z)
            p0, p1, p2 = patch[0, k], patch[1, k], patch[2, k]
            p3, p4, p5 = patch[3, k], patch[4, k], patch[5, k]
            a, b, c = u * p0 + v * p3 + w * p5, u * p3 + v * p1 + w * p4, u * p5 + v * p4 + w * p2
            r = u * a + v * b + w * c - q
            du, dv = 2.0 * (a - c), 2.0 * (b - c)
            fu += r * du
            fv += r * dv
            huu += du * du
            huv += du * dv
            hvv += dv * dv
            quu += r * 2.0 * (p0 - 2.0 * p5 + p2)
            quv += r * 2.0 * (p3 - p5 - p4 + p2)
            qvv += r * 2.0 * (p1 - 2.0 * p4 + p2)
        a, b, c = huu + quu, huv + quv, hvv + qvv
        det = a * c - b * b
        convex = a > 0.0 and det > 1e-6 * huu * hvv
        if not convex:
            # The Gauss-Newton step goes downhill.
            a, b, c = huu, huv, hvv
            det = a * c - b * b
            if det <= 1e-28 * huu * hvv:
                return u, v, False
        su, sv = (c * fu - b * fv) / det, (a * fv - b * fu) / det
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


@njit
def _distance2(patch, u, v, x, y, z):  # type: ignore[no-untyped-def]
    w = 1.0 - u - v
    total = 0.0
    for k in range(3):
        q = x if k == 0 else (y if k == 1 else z)
        r = (
            u * u * patch[0, k]
            + v * v * patch[1, k]
            + w * w * patch[2, k]
            + 2.0 * (u * v * patch[3, k] + v * w * patch[4, k] + w * u * patch[5, k])
            - q
        )
        total += r * r
    return total


@njit
def _closest_on_edge(patch, edge, x, y, z):  # type: ignore[no-untyped-def]
    """Closest point of an edge: its parameter from corner ``edge`` on, and the squared distance."""
    last = (edge + 1) % 3
    # |c0 + c1 t + c2 t^2|^2 as a polynomial of degree four in t.
    q0 = q1 = q2 = q3 = q4 = 0.0
    for k in range(3):
        q = x if k == 0 else (y if k == 1 else z)
        c0 = patch[edge, k] - q
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
        q = x if k == 0 else (y if k == 1 else z)
        r = s * s * patch[edge, k] + 2.0 * s * t * patch[3 + edge, k] + t * t * patch[last, k] - q
        total += r * r
    return t, total


@njit
def flat_distance2(patch, x, y, z):  # type: ignore[no-untyped-def]
    """Squared distance to the flat triangle of a patch's corners [m^2]."""
    ax, ay, az = patch[0, 0] - patch[2, 0], patch[0, 1] - patch[2, 1], patch[0, 2] - patch[2, 2]
    bx, by, bz = patch[1, 0] - patch[2, 0], patch[1, 1] - patch[2, 1], patch[1, 2] - patch[2, 2]
    px, py, pz = x - patch[2, 0], y - patch[2, 1], z - patch[2, 2]
    aa, ab, bb = ax * ax + ay * ay + az * az, ax * bx + ay * by + az * bz, bx * bx + by * by + bz * bz
    pa, pb = px * ax + py * ay + pz * az, px * bx + py * by + pz * bz
    pp = px * px + py * py + pz * pz
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
