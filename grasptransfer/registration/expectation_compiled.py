"""The E-step as one compiled loop: one exponential per pair of points, no n x m array.

Each call handles a range of target points and may run beside others: it holds no lock. Distances
are taken from differences, in float32, so that they stay exact when sigma is small.
"""

from typing import no_type_check

import numpy as np
from numba import njit, types
from numba.extending import intrinsic

from grasptransfer.registration import blocks

# Written here again because numba's cache notices changes of this file only.
GROUP, BLOCK = 8, 32
assert (GROUP, BLOCK) == (blocks.GROUP, blocks.BLOCK)

LOG2_E = 1.4426950408889634
LOG_2 = 0.6931471805599453
# No infinities and no NaN occur below; sums may be taken in any order, so loops become vector code.
RELAXED = {"reassoc", "contract", "nnan", "nsz"}


@intrinsic
def _float_of_bits(typing_context, bits):
    """The float32 with these bits."""

    def generate(context, builder, signature, arguments):
        return builder.bitcast(arguments[0], context.get_value_type(types.float32))

    return types.float32(types.int32), generate


@njit(inline="always")
@no_type_check
def _power_of_two(x):
    """2^x for -126 <= x <= 0, to 1e-7: whole part into the exponent bits, the rest by a polynomial."""
    whole = np.int32(x)
    rest = x - np.float32(whole)  # in (-1, 0]
    value = np.float32(9.4490e-4)
    value = value * rest + np.float32(9.20580e-3)
    value = value * rest + np.float32(5.529736e-2)
    value = value * rest + np.float32(2.4018014e-1)
    value = value * rest + np.float32(6.9314372e-1)
    value = value * rest + np.float32(1.0)
    return value * _float_of_bits(np.int32((whole + np.int32(127)) << np.int32(23)))


@njit(inline="always")
@no_type_check
def _least(values):
    """Minimum of numbers that are not NaN; `values.min()` looks for NaN, one by one."""
    least = np.float32(3e38)
    for i in range(len(values)):
        least = min(least, values[i])
    return least


@njit(nogil=True, cache=True, fastmath=RELAXED, error_model="numpy")
@no_type_check
def _near_blocks(targets, low, high, bound, reach, near, closest):
    """Write the indices of the source boxes that matter to these (3, g) targets; return their count.

    A box is skipped when each of its points is farther from each target than the nearest source
    point is, by `reach` in squared distance. No target has its nearest beyond `bound` (squared).
    """
    x_low, y_low, z_low = _least(targets[0]), _least(targets[1]), _least(targets[2])
    x_high, y_high, z_high = -_least(-targets[0]), -_least(-targets[1]), -_least(-targets[2])
    xs, ys, zs, xe, ye, ze = low[0], low[1], low[2], high[0], high[1], high[2]
    limit, zero = bound, np.float32(0.0)
    for block in range(len(xs)):
        x_gap = max(xs[block] - x_high, x_low - xe[block], zero)
        y_gap = max(ys[block] - y_high, y_low - ye[block], zero)
        z_gap = max(zs[block] - z_high, z_low - ze[block], zero)
        x_span = max(xe[block] - x_low, x_high - xs[block])
        y_span = max(ye[block] - y_low, y_high - ys[block])
        z_span = max(ze[block] - z_low, z_high - zs[block])
        closest[block] = x_gap * x_gap + y_gap * y_gap + z_gap * z_gap
        limit = min(limit, x_span * x_span + y_span * y_span + z_span * z_span)
    found = 0
    for block in range(len(xs)):
        near[found] = block  # overwritten by the next unless this box counts: no branch to mispredict
        found += closest[block] <= limit + reach
    return found


@njit(nogil=True, cache=True, fastmath=RELAXED, error_model="numpy")
@no_type_check
def expect(
    targets,
    first,
    last,
    moved,
    low,
    high,
    traits,
    moved_traits,
    variance,
    reach,
    log_outlier,
    sums,
    inlier,
    nearest,
):
    """Responsibilities of targets [first, last), summed up as the M-step needs them.

    Args:
        targets: (3, m) float32.
        first, last: of a range of targets; `first` is a multiple of GROUP.
        moved: (3 n,) float32 source points, box by box: BLOCK times x, y, then z; padded far away.
        low, high: (3, n / BLOCK) corners of the boxes.
        traits, moved_traits: (t, m), (t, n) float32 other properties of the points, t may be 0: a
            difference d in one makes a match less likely by 2^(-d^2).
        reach: squared distance beyond the nearest source point where the kernel counts as zero.
        log_outlier: log of the outlier term beside the sum of exponentials.
        sums: (4 n,) float32, box by box: P 1, then P X; added to.
        inlier: (m,) P^T 1, written.
        nearest: (m,) float32 upper bounds of the squared distance to the nearest source point; the
            distance itself is written.

    Returns:
        sum of P times squared distance; sum of log(sum of exponentials + outlier term).
    """
    near, closest = np.empty(low.shape[1], np.int64), np.empty(low.shape[1], np.float32)
    value = np.zeros((GROUP, low.shape[1] * BLOCK), np.float32)
    distances, costs = np.empty(value.shape[1], np.float32), np.empty(value.shape[1], np.float32)
    share = np.zeros(GROUP, np.float32)
    factor = np.float32(-0.5 * LOG2_E / variance)
    squared, likelihood = 0.0, 0.0
    for start in range(first, last, GROUP):
        count = min(GROUP, last - start)
        bound = -_least(-nearest[start : start + count])
        found = _near_blocks(targets[:, start : start + count], low, high, bound, reach, near, closest)
        share[count:] = 0.0
        for j in range(count):
            row, distance = value[j, : found * BLOCK], distances[: found * BLOCK]
            _measure(
                distance, moved, near, targets[0, start + j], targets[1, start + j], targets[2, start + j]
            )
            nearest[start + j] = least = _least(distance)
            cost = distance
            if len(traits):
                cost = costs[: found * BLOCK]
                cost[:] = distance
                for trait in range(len(traits)):
                    _compare(
                        cost, moved_traits[trait], near, traits[trait, start + j], np.float32(-1.0) / factor
                    )
                least = _least(cost)
            total, weighted = np.float32(0.0), np.float32(0.0)
            for i in range(len(row)):
                power = _power_of_two(max((cost[i] - least) * factor, np.float32(-126.0)))
                row[i] = power
                total += power
                weighted += power * distance[i]
            log_inlier = np.log(total) - 0.5 * least / variance
            larger, smaller = max(log_inlier, log_outlier), min(log_inlier, log_outlier)
            log_all = larger + np.log1p(np.exp(smaller - larger))
            belongs = np.exp(log_inlier - log_all)
            share[j] = belongs / total
            inlier[start + j] = belongs
            squared += belongs / total * weighted
            likelihood += log_all
        for j in range(0, count, 4):
            _add(sums, value[j : j + 4], share[j : j + 4], targets, start + j, near, found)
    return squared, likelihood


@njit(nogil=True, cache=True, fastmath=RELAXED, error_model="numpy")
@no_type_check
def _measure(distance, moved, near, x, y, z):
    """Squared distances of one target to the near boxes' points."""
    for block in range(len(distance) // BLOCK):
        points = moved[3 * BLOCK * near[block] : 3 * BLOCK * (near[block] + 1)]
        part = distance[BLOCK * block : BLOCK * (block + 1)]
        for i in range(BLOCK):
            dx, dy, dz = points[i] - x, points[i + BLOCK] - y, points[i + 2 * BLOCK] - z
            part[i] = dx * dx + dy * dy + dz * dz


@njit(nogil=True, cache=True, fastmath=RELAXED, error_model="numpy")
@no_type_check
def _compare(cost, moved_trait, near, value, scale):
    """Add what one differing trait costs, in units of squared distance."""
    for block in range(len(cost) // BLOCK):
        others = moved_trait[BLOCK * near[block] : BLOCK * (near[block] + 1)]
        part = cost[BLOCK * block : BLOCK * (block + 1)]
        for i in range(BLOCK):
            part[i] += scale * (others[i] - value) * (others[i] - value)


@njit(nogil=True, cache=True, fastmath=RELAXED, error_model="numpy")
@no_type_check
def _add(sums, value, share, targets, start, near, found):
    """Add four targets' responsibilities: one load and store of the sums serves all four."""
    end = targets.shape[1] - 1
    a, b, c, d = start, min(start + 1, end), min(start + 2, end), min(start + 3, end)
    sa, sb, sc, sd = share[0], share[1], share[2], share[3]
    xa, xb, xc, xd = targets[0, a], targets[0, b], targets[0, c], targets[0, d]
    ya, yb, yc, yd = targets[1, a], targets[1, b], targets[1, c], targets[1, d]
    za, zb, zc, zd = targets[2, a], targets[2, b], targets[2, c], targets[2, d]
    for block in range(found):
        part = sums[4 * BLOCK * near[block] : 4 * BLOCK * (near[block] + 1)]
        here = slice(BLOCK * block, BLOCK * (block + 1))
        va, vb, vc, vd = value[0, here], value[1, here], value[2, here], value[3, here]
        for i in range(BLOCK):
            pa, pb, pc, pd = va[i] * sa, vb[i] * sb, vc[i] * sc, vd[i] * sd
            part[i] += pa + pb + pc + pd
            part[i + BLOCK] += pa * xa + pb * xb + pc * xc + pd * xd
            part[i + 2 * BLOCK] += pa * ya + pb * yb + pc * yc + pd * yd
            part[i + 3 * BLOCK] += pa * za + pb * zb + pc * zc + pd * zd
