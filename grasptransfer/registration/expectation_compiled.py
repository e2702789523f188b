"""The E-step as one compiled loop: one exponential per pair of points, no n x m array.

Each call handles a range of target points and may run beside others: it holds no lock. A group of
targets shares one list of near source boxes; their points are first brought together, so that all
that follows runs over plain rows. Distances are taken from differences, in float32, so that they
stay exact when sigma is small.
"""

from typing import no_type_check

import numpy as np
from numba import njit

from grasptransfer.registration import blocks
from grasptransfer.registration.vector_code import add_box, bits_of_float, copy_box, float_of_bits, smaller

# Written here again because numba's cache notices changes of this file only.
GROUP, BLOCK = 8, 16
assert (GROUP, BLOCK) == (blocks.GROUP, blocks.BLOCK)

WIDE = 8 * GROUP  # targets whose near boxes are looked for in all boxes, a group's only in those
STRIP = 64  # rows end at multiples of this: what is left over would be handled one by one
FAR = 1e9
LARGEST_EXPONENT = 80.0  # of the outlier term: eight of e^80 multiply without overflow
LOG2_E = 1.4426950408889634
# No infinities and no NaN occur below; sums may be taken in any order, so loops become vector code.
RELAXED = {"reassoc", "contract", "nnan", "nsz"}
COMPILE = {"nogil": True, "cache": True, "fastmath": RELAXED, "error_model": "numpy"}
WITHIN = {**COMPILE, "forceinline": True}  # where a call would cost as much as its work


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
    return float_of_bits(np.int32(bits_of_float(value) + np.int32(whole << np.int32(23))))


@njit(inline="always")
@no_type_check
def _extent(values):
    """Least and largest of a few numbers."""
    low = high = values[0]
    for i in range(1, len(values)):
        low, high = min(low, values[i]), max(high, values[i])
    return low, high


@njit(**COMPILE)
@no_type_check
def _near_boxes(targets, low, high, count, bound, reach, near, closest):
    """Of the first `count` source boxes those that matter to these (3, g) targets; how many they are.

    A box is skipped when each of its points is farther from each target than the nearest source
    point is, by `reach` in squared distance. No target has its nearest beyond `bound` (squared).
    """
    x_low, x_high = _extent(targets[0])
    y_low, y_high = _extent(targets[1])
    z_low, z_high = _extent(targets[2])
    xs, ys, zs = low[0, :count], low[1, :count], low[2, :count]
    xe, ye, ze = high[0, :count], high[1, :count], high[2, :count]
    limit, zero = bound, np.float32(0.0)
    for box in range(len(xs)):
        x_gap = max(xs[box] - x_high, x_low - xe[box], zero)
        y_gap = max(ys[box] - y_high, y_low - ye[box], zero)
        z_gap = max(zs[box] - z_high, z_low - ze[box], zero)
        x_span = max(xe[box] - x_low, x_high - xs[box])
        y_span = max(ye[box] - y_low, y_high - ys[box])
        z_span = max(ze[box] - z_low, z_high - zs[box])
        closest[box] = x_gap * x_gap + y_gap * y_gap + z_gap * z_gap
        limit = smaller(limit, x_span * x_span + y_span * y_span + z_span * z_span)
    found = 0
    for box in range(len(xs)):
        near[found] = box  # overwritten by the next unless this box counts: no branch to mispredict
        found += closest[box] <= limit + reach
    return found


@njit(**COMPILE)
@no_type_check
def _choose(corners, chosen, few):
    """Corners of the chosen boxes only."""
    for axis in range(3):
        for i in range(len(chosen)):
            few[axis, i] = corners[axis, chosen[i]]


@njit(**WITHIN)
@no_type_check
def _gather(boxes, near, rows):
    """Bring the near boxes' points together, one row for each property; returns the rows' length."""
    kinds, width = len(rows), rows.shape[1]
    end = len(near) * BLOCK
    flat, together = boxes.ravel(), rows.ravel()
    for i in range(len(near)):
        for kind in range(kinds):
            copy_box(together, kind * width + i * BLOCK, flat, (near[i] * kinds + kind) * BLOCK)
    length = -(-end // STRIP) * STRIP
    rows[0, end:length] = FAR
    return length


@njit(**WITHIN)
@no_type_check
def _measure(distance, xs, ys, zs, x, y, z):
    """Squared distances of one target to source points; the least of them."""
    least = np.float32(3e38)
    for i in range(len(distance)):
        dx, dy, dz = xs[i] - x, ys[i] - y, zs[i] - z
        squared = dx * dx + dy * dy + dz * dz
        distance[i] = squared
        least = smaller(least, squared)
    return least


@njit(**COMPILE)
@no_type_check
def _compare(cost, distance, traits, rows, target, scale):
    """Distances and what differing traits cost beside them, in units of squared distance; the least."""
    cost[:] = distance
    for trait in range(len(traits)):
        value, row = traits[trait, target], rows[3 + trait, : len(cost)]
        for i in range(len(cost)):
            cost[i] += scale * (row[i] - value) * (row[i] - value)
    least = np.float32(3e38)
    for i in range(len(cost)):
        least = smaller(least, cost[i])
    return least


@njit(**WITHIN)
@no_type_check
def _weigh(power, cost, distance, least, factor):
    """Write 2^(factor (cost - least)); their sum, and that of them times squared distance."""
    total, weighted = np.float32(0.0), np.float32(0.0)
    for i in range(len(power)):
        value = _power_of_two(max((cost[i] - least) * factor, np.float32(-126.0)))
        power[i] = value
        total += value
        weighted += value * distance[i]
    return total, weighted


@njit(**WITHIN)
@no_type_check
def _add_four(sums, powers, share, xyz, first, length):
    """Add four targets' responsibilities: one load and store of the sums serves all four."""
    support, x_moment, y_moment, z_moment = (
        sums[0, :length],
        sums[1, :length],
        sums[2, :length],
        sums[3, :length],
    )
    pa, pb = powers[first, :length], powers[first + 1, :length]
    pc, pd = powers[first + 2, :length], powers[first + 3, :length]
    sa, sb, sc, sd = share[first], share[first + 1], share[first + 2], share[first + 3]
    xa, ya, za = xyz[0, first] * sa, xyz[1, first] * sa, xyz[2, first] * sa
    xb, yb, zb = xyz[0, first + 1] * sb, xyz[1, first + 1] * sb, xyz[2, first + 1] * sb
    xc, yc, zc = xyz[0, first + 2] * sc, xyz[1, first + 2] * sc, xyz[2, first + 2] * sc
    xd, yd, zd = xyz[0, first + 3] * sd, xyz[1, first + 3] * sd, xyz[2, first + 3] * sd
    for i in range(length):
        a, b, c, d = pa[i], pb[i], pc[i], pd[i]
        support[i] += a * sa + b * sb + c * sc + d * sd
        x_moment[i] += a * xa + b * xb + c * xc + d * xd
        y_moment[i] += a * ya + b * yb + c * yc + d * yd
        z_moment[i] += a * za + b * zb + c * zc + d * zd


@njit(**COMPILE)
@no_type_check
def _scatter(group_sums, near, sums):
    """Add a group's sums to those of the boxes."""
    together, flat = group_sums.ravel(), sums.ravel()
    for i in range(len(near)):
        for row in range(4):
            add_box(flat, (near[i] * 4 + row) * BLOCK, together, row * group_sums.shape[1] + i * BLOCK)


@njit(**WITHIN)
@no_type_check
def _expect_group(targets, piece, rows, length, kernel, scratch, found):
    """Responsibilities of the targets of a piece among the source points in `rows`, added to the sums."""
    (points, traits), (first, last), (inlier, nearest) = targets, piece, found
    (variance, _, log_outlier), (powers, costs, sums) = kernel, scratch
    factor, half = np.float32(-0.5 * LOG2_E / variance), 0.5 / variance
    xyz, share = np.zeros((3, GROUP), np.float32), np.zeros(GROUP, np.float32)
    squared, likelihood, product = 0.0, 0.0, 1.0
    for j in range(last - first):
        x, y, z = points[0, first + j], points[1, first + j], points[2, first + j]
        xyz[0, j], xyz[1, j], xyz[2, j] = x, y, z
        distance = cost = costs[0, :length]
        nearest[first + j] = least = _measure(
            distance, rows[0, :length], rows[1, :length], rows[2, :length], x, y, z
        )
        if len(traits):
            cost = costs[1, :length]
            least = _compare(cost, distance, traits, rows, first + j, np.float32(-1.0) / factor)
        total, weighted = _weigh(powers[j, :length], cost, distance, least, factor)
        exponent = log_outlier + half * least
        outlier = np.exp(min(exponent, LARGEST_EXPONENT)) if exponent > -LARGEST_EXPONENT else 0.0
        everything = total + outlier
        product *= everything
        likelihood += max(exponent - LARGEST_EXPONENT, 0.0) - half * least
        share[j] = 1.0 / everything
        inlier[first + j] = total / everything
        squared += weighted / everything
    for j in range(0, last - first, 4):
        _add_four(sums, powers, share, xyz, j, length)
    return squared, likelihood + np.log(product)


@njit(**COMPILE)
@no_type_check
def expect(targets, piece, boxes, corners, kernel, found, sums):
    """Responsibilities of a piece of the targets, summed up as the M-step needs them.

    Args:
        targets: (3, m) float32 points, and (t, m) float32 other properties of them; t may be 0. A
            difference d in one of these makes a match less likely by 2^(-d^2).
        piece: first and last of the targets [first, last); `first` is a multiple of GROUP.
        boxes: (b, 3 + t, BLOCK) float32 source points and their traits, box by box; padded far away.
        corners: (3, b) least and (3, b) largest coordinates of the boxes.
        kernel: variance; squared distance beyond the nearest source point where the kernel counts as zero;
            logarithm of the outlier term beside the sum of exponentials.
        found: written: (m,) P^T 1, and (m,) float32 squared distances to the nearest source point, which come
            as upper bounds.
        sums: (b, 4, BLOCK) float32 P 1, then P X; added to.

    Returns:
        sum of P times squared distance; sum of log(sum of exponentials + outlier term).
    """
    points, (first, last), (low, high), reach, nearest = targets[0], piece, corners, kernel[1], found[1]
    count, width = len(boxes), -(-len(boxes) * BLOCK // STRIP) * STRIP
    wide, near, closest = np.empty(count, np.int64), np.empty(count, np.int64), np.empty(count, np.float32)
    few_low, few_high = np.empty((3, count), np.float32), np.empty((3, count), np.float32)
    rows, group_sums = np.zeros((boxes.shape[1], width), np.float32), np.zeros((4, width), np.float32)
    powers, costs = np.zeros((GROUP, width), np.float32), np.empty((2, width), np.float32)
    squared, likelihood = 0.0, 0.0
    for start in range(first, last, WIDE):
        stop = min(start + WIDE, last)
        bound = _extent(nearest[start:stop])[1]
        few = _near_boxes(points[:, start:stop], low, high, count, bound, reach, wide, closest)
        _choose(low, wide[:few], few_low)
        _choose(high, wide[:few], few_high)
        for group in range(start, stop, GROUP):
            end = min(group + GROUP, stop)
            bound = _extent(nearest[group:end])[1]
            own = _near_boxes(points[:, group:end], few_low, few_high, few, bound, reach, near, closest)
            for i in range(own):
                near[i] = wide[near[i]]
            length = _gather(boxes, near[:own], rows)
            group_sums[:, :length] = 0.0
            scratch = powers, costs, group_sums
            added = _expect_group(targets, (group, end), rows, length, kernel, scratch, found)
            squared += added[0]
            likelihood += added[1]
            _scatter(group_sums, near[:own], sums)
    return squared, likelihood
