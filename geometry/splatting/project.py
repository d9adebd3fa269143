"""Kernels: cull chunks by the view, and project their Gaussians to the image (EWA splatting).

Zwicker et al., "EWA splatting" (2002), as Kerbl et al. (2023) use it: the covariance goes through
the Jacobian of the perspective projection, and a pixel's blur of 0.3 px² is added.
"""

import math

import numpy as np

from ...formats.process.kernel import kernel
from .scene import MIN_ALPHA, STEP

TILE = 16
BLUR_PX2 = 0.3
# Beyond this multiple of the field of view the Jacobian is that of its edge.
FRAME_MARGIN = 1.3
# Columns of a projected Gaussian: mean x and y [px]; conic xx, xy, yy [1/px²]; opacity; largest
# exponent drawn; half extents [px]; RGB; depth gradient [m/px]; depth [m].
(X, Y, CONIC_XX, CONIC_XY, CONIC_YY, OPACITY, LIMIT, HALF_X, HALF_Y, RED, GREEN, BLUE, SLOPE_X,
 SLOPE_Y, DEPTH) = range(15)  # fmt: skip
COLUMNS = 15


@kernel(3)
def cull_chunks(low, high, reach, rotation, eye, view, depth):
    """Write the least depth of each chunk's centres (C,) [m]; inf where none is in view.

    `view` holds half the image's width and height over the focal length, and the near plane [m].
    """
    right, down, near = view[0], view[1], view[2]
    planes = np.empty((5, 3))
    for i in range(3):
        planes[0, i] = rotation[i, 2]
        planes[1, i] = right * rotation[i, 2] + rotation[i, 0]
        planes[2, i] = right * rotation[i, 2] - rotation[i, 0]
        planes[3, i] = down * rotation[i, 2] + rotation[i, 1]
        planes[4, i] = down * rotation[i, 2] - rotation[i, 1]
    length = np.sqrt((planes * planes).sum(axis=1))
    for c in range(low.shape[0]):
        depth[c] = np.inf
        outside = False
        for p in range(5):
            most = reach[c] * length[p]
            for i in range(3):
                ends = planes[p, i] * (low[c, i] - eye[i]), planes[p, i] * (high[c, i] - eye[i])
                most += max(ends[0], ends[1])
            if most < (near if p == 0 else 0.0):
                outside = True
                break
        if outside:
            continue
        least = 0.0
        for i in range(3):
            a, b = rotation[i, 2] * (low[c, i] - eye[i]), rotation[i, 2] * (high[c, i] - eye[i])
            least += min(a, b)
        depth[c] = max(least, near)


@kernel(3, error_model="numpy")
def project_chunks(chunks, scene, bounds, eye, unfinished, out, first):
    """Project the Gaussians of `chunks` into rows of `out` from `first` on; return their end.

    Chunks and Gaussians that can only touch finished pixels are left out.

    Args:
        chunks: (M,) chunk numbers.
        scene: position, covariance, opacity, colour, harmonics and starts as in `SplatScene`.
        bounds: lower and upper bounds of chunks, and how far beyond them they are seen.
        eye: (3, 3) optical axes in the world; (3,) optical centre [m]; focal length [px], image
            width and height [px], near plane [m], whether anti-aliased (1 or 0), and the height
            above which nothing is drawn [m].
        unfinished: (height + 1, width + 1) see `count_unfinished`.
        out: (N, 15) see `COLUMNS`.
        first: first row to write.
    """
    position, covariance, opacity, color, harmonics, starts = scene
    rotation, center, lens = eye
    focal, width, height, near = lens[0], int(lens[1]), int(lens[2]), lens[3]
    antialiased, cut = lens[4] > 0, lens[5]
    cx, cy = 0.5 * (width - 1), 0.5 * (height - 1)
    limit_x = FRAME_MARGIN * 0.5 * width / focal
    limit_y = FRAME_MARGIN * 0.5 * height / focal
    r00, r01, r02 = rotation[0, 0], rotation[0, 1], rotation[0, 2]
    r10, r11, r12 = rotation[1, 0], rotation[1, 1], rotation[1, 2]
    r20, r21, r22 = rotation[2, 0], rotation[2, 1], rotation[2, 2]
    lens32 = np.float32(focal)
    k = first
    for c in chunks:
        if _hidden(bounds, c, eye, unfinished):
            continue
        for g in range(starts[c], starts[c + 1]):
            if position[g, 2] > cut:
                continue
            dx = position[g, 0] - center[0]
            dy = position[g, 1] - center[1]
            dz = position[g, 2] - center[2]
            z = r02 * dx + r12 * dy + r22 * dz
            if z < near:
                continue
            x = r00 * dx + r10 * dy + r20 * dz
            y = r01 * dx + r11 * dy + r21 * dz
            inverse = 1.0 / z
            mx, my = focal * x * inverse + cx, focal * y * inverse + cy
            # The covariance along the rows of the Jacobian times the view rotation.
            tx = min(max(x * inverse, -limit_x), limit_x)
            ty = min(max(y * inverse, -limit_y), limit_y)
            f = lens32 * inverse
            ux, uy, uz = f * (r00 - tx * r02), f * (r10 - tx * r12), f * (r20 - tx * r22)
            vx, vy, vz = f * (r01 - ty * r02), f * (r11 - ty * r12), f * (r21 - ty * r22)
            s0, s1, s2 = covariance[g, 0], covariance[g, 1], covariance[g, 2]
            s3, s4, s5 = covariance[g, 3], covariance[g, 4], covariance[g, 5]
            px, qx = s0 * ux + s1 * uy + s2 * uz, s0 * vx + s1 * vy + s2 * vz
            py, qy = s1 * ux + s3 * uy + s4 * uz, s1 * vx + s3 * vy + s4 * vz
            pz, qz = s2 * ux + s4 * uy + s5 * uz, s2 * vx + s4 * vy + s5 * vz
            a = ux * px + uy * py + uz * pz
            b = ux * qx + uy * qy + uz * qz
            d = vx * qx + vy * qy + vz * qz
            o = opacity[g]
            sharp = a * d - b * b
            a += BLUR_PX2
            d += BLUR_PX2
            det = a * d - b * b
            if antialiased:
                o *= math.sqrt(max(sharp / det, 0.000025))
            if o < MIN_ALPHA:
                continue
            limit = 2.0 * math.log(o / MIN_ALPHA)
            half_x, half_y = math.sqrt(limit * a), math.sqrt(limit * d)
            x0, x1 = mx - half_x, mx + half_x
            y0, y1 = my - half_y, my + half_y
            if x1 < 0 or y1 < 0 or x0 > width - 1 or y0 > height - 1:
                continue
            if not any_unfinished(unfinished, x0, x1, y0, y1):
                continue
            out[k, X], out[k, Y], out[k, DEPTH] = mx, my, z
            out[k, CONIC_XX], out[k, CONIC_XY], out[k, CONIC_YY] = d / det, -b / det, a / det
            out[k, OPACITY], out[k, LIMIT] = o, limit
            out[k, HALF_X], out[k, HALF_Y] = half_x, half_y
            # Depth along the ray of a pixel: the mean of z given the place in the image, which the
            # pixel's blur must not flatten, and which is never further off than the Gaussian is.
            gx = px * r02 + py * r12 + pz * r22
            gy = qx * r02 + qy * r12 + qz * r22
            firm = 0.01 + 0.002 * (a + d)
            aa, dd = a - BLUR_PX2 + firm, d - BLUR_PX2 + firm
            slant = aa * dd - b * b
            slope_x, slope_y = (dd * gx - b * gy) / slant, (aa * gy - b * gx) / slant
            along = s0 * r02 * r02 + s3 * r12 * r12 + s5 * r22 * r22
            along += 2 * (s1 * r02 * r12 + s2 * r02 * r22 + s4 * r12 * r22)
            most = 6.0 * math.sqrt(max(along, 0.0))
            share = most / max(abs(slope_x) * half_x + abs(slope_y) * half_y, most + 1e-12)
            out[k, SLOPE_X], out[k, SLOPE_Y] = slope_x * share, slope_y * share
            if harmonics.shape[1] == 0:
                for i in range(3):
                    out[k, RED + i] = max(color[g, i], np.float32(0))
            else:
                _shade(color, harmonics, g, (dx, dy, dz), out, k)
            k += 1
    return k


@kernel(3, inline="always")
def any_unfinished(unfinished, x0, x1, y0, y1):
    """Return whether a rectangle [px] holds the centre of an unfinished pixel."""
    left, top = max(math.ceil(x0), 0), max(math.ceil(y0), 0)
    right = min(math.floor(x1) + 1, unfinished.shape[1] - 1)
    bottom = min(math.floor(y1) + 1, unfinished.shape[0] - 1)
    if left >= right or top >= bottom:
        return False
    count = unfinished[bottom, right] - unfinished[top, right]
    return count - unfinished[bottom, left] + unfinished[top, left] > 0


@kernel(3)
def _hidden(bounds, c, eye, unfinished):
    """Return whether a chunk can only touch finished pixels."""
    low, high, reach = bounds
    rotation, center, lens = eye
    focal, width, height, near = lens[0], lens[1], lens[2], lens[3]
    x0, x1, y0, y1 = np.inf, -np.inf, np.inf, -np.inf
    for corner in range(8):
        x, y, z = 0.0, 0.0, 0.0
        for i in range(3):
            side = high[c, i] + reach[c] if corner >> i & 1 else low[c, i] - reach[c]
            x += rotation[i, 0] * (side - center[i])
            y += rotation[i, 1] * (side - center[i])
            z += rotation[i, 2] * (side - center[i])
        if z < near:
            return False
        u, v = focal * x / z + 0.5 * (width - 1), focal * y / z + 0.5 * (height - 1)
        x0, x1, y0, y1 = min(x0, u), max(x1, u), min(y0, v), max(y1, v)
    # Two pixels for the blur.
    return not any_unfinished(
        unfinished,
        min(max(x0 - 2, -1.0), width),
        max(min(x1 + 2, width), -1.0),
        min(max(y0 - 2, -1.0), height),
        max(min(y1 + 2, height), -1.0),
    )


@kernel(3)
def _shade(color, harmonics, g, direction, out, k):
    """Write the colour of a Gaussian as seen along a direction (3,)."""
    dx, dy, dz = direction
    length = math.sqrt(dx * dx + dy * dy + dz * dz)
    x, y, z = dx / length, dy / length, dz / length
    count = harmonics.shape[1]
    xx, yy, zz = x * x, y * y, z * z
    for i in range(3):
        value = 0.0
        value += 0.4886025119029199 * (
            -y * harmonics[g, 0, i] + z * harmonics[g, 1, i] - x * harmonics[g, 2, i]
        )
        if count > 3:
            value += 1.0925484305920792 * (
                x * y * harmonics[g, 3, i] - y * z * harmonics[g, 4, i] - x * z * harmonics[g, 6, i]
            )
            value += 0.31539156525252005 * (2 * zz - xx - yy) * harmonics[g, 5, i]
            value += 0.5462742152960396 * (xx - yy) * harmonics[g, 7, i]
        if count > 8:
            value -= 0.5900435899266435 * (
                y * (3 * xx - yy) * harmonics[g, 8, i] + x * (xx - 3 * yy) * harmonics[g, 14, i]
            )
            value += 2.890611442640554 * x * y * z * harmonics[g, 9, i]
            pair = y * harmonics[g, 10, i] + x * harmonics[g, 12, i]
            value -= 0.4570457994644658 * (4 * zz - xx - yy) * pair
            value += 0.3731763325901154 * z * (2 * zz - 3 * xx - 3 * yy) * harmonics[g, 11, i]
            value += 1.445305721320277 * z * (xx - yy) * harmonics[g, 13, i]
        out[k, RED + i] = max(color[g, i] + STEP * value, 0.0)
