"""The paper's study as one would write it in NumPy and SciPy, a trial at a time: what the core is compared with.

The same scenes, methods, RANSAC and stopping rule as `sonocal.studies`, each step by the library's own function:
SVD, LU and eigenvalues by LAPACK, refinement by `scipy.optimize.least_squares` with its numeric Jacobian (MINPACK's
Levenberg-Marquardt), noise levels by `scipy.optimize.minimize` on the restricted likelihood.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable

import numpy as np
from scipy.linalg import lu, qr
from scipy.optimize import least_squares, minimize
from scipy.spatial.transform import Rotation

Table = tuple[
    np.ndarray, np.ndarray, np.ndarray, int
]  # points (N, 3), segments (N, 2, 3), sightings (N,), dimension
CONFIDENCE, MAX_SAMPLES, FEWEST_SAMPLES = 0.99, 1000, 20
QUADRICS = [(0, 0, 1, 1), (0, 0, 2, 2), (0, 1, None, None), (0, 2, None, None), (1, 2, None, None)]


def planes_of(segments: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Two unit normals (N, 2, 3) of each line, and a point (N, 3) of it."""
    along = segments[:, 1] - segments[:, 0]
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    axis = np.eye(3)[np.abs(along).argmin(axis=1)]
    first = np.cross(along, axis)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    return np.stack([first, np.cross(along, first)], axis=1), segments[:, 0]


def distances(matrix: np.ndarray, points: np.ndarray, segments: np.ndarray) -> np.ndarray:
    along = segments[:, 1] - segments[:, 0]
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    away = points @ matrix[:3, :3].T + matrix[:3, 3] - segments[:, 0]
    return np.linalg.norm(away - np.sum(away * along, axis=1, keepdims=True) * along, axis=1)


def linear_rows(points: np.ndarray, segments: np.ndarray, columns: int) -> np.ndarray:
    """Rows of the linear system in the columns of S, t and 1 (paper eq. 4-7)."""
    normals, on_line = planes_of(segments)
    offsets = -np.einsum("nki,ni->nk", normals, on_line)
    parts = [points[:, None, c, None] * normals for c in range(columns)]
    return np.concatenate([*parts, normals, offsets[..., None]], axis=2).reshape(-1, 3 * columns + 4)


def similarity(s: np.ndarray, t: np.ndarray, planar: bool) -> np.ndarray | None:
    """The paper's projection by QR."""
    r, triangle = qr(s[:, :2] if planar else s)
    signs = np.sign(np.diag(triangle))
    rotation = r[:, : len(signs)] * signs
    scale = np.abs(np.diag(triangle)).mean()
    if planar:
        rotation = np.column_stack([rotation[:, :2], np.cross(rotation[:, 0], rotation[:, 1])])
    if np.linalg.det(rotation) < 0 or not np.isfinite(scale):
        return None
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = scale * rotation, t
    return matrix


def linear(points: np.ndarray, segments: np.ndarray, dimension: int) -> list[np.ndarray]:
    """5point2D and 3line3D, for any number of rows, centred and scaled."""
    centre, size = points.mean(axis=0), np.std(points) * 2
    middle = segments.mean(axis=(0, 1))
    extent = np.std(segments - middle) * 2
    columns = dimension
    rows = linear_rows((points - centre) / size, (segments - middle) / extent, columns)
    v = np.linalg.svd(rows)[2][-1]
    v = v / v[-1]
    s = v[: 3 * columns].reshape(columns, 3).T
    found = similarity(s, v[-4:-1], planar=dimension == 2)
    if found is None:
        return []
    out = np.eye(4)
    out[:3, :3] = found[:3, :3] * extent / size
    out[:3, 3] = middle + extent * found[:3, 3] - out[:3, :3] @ centre
    return [out]


def monomials() -> tuple[dict[tuple[int, ...], int], int]:
    last = ["bbb", "abb", "be1", "bd1", "bc1", "bb1", "ab1", "e11", "d11", "c11", "b11", "a11", "111"]
    order = {c: i for i, c in enumerate("abcde1")}
    wanted = [tuple(sorted(order[c] for c in name)) for name in last]
    every = [m for m in itertools.combinations_with_replacement(range(6), 3) if m != (4, 4, 4)]
    first = [m for m in every if m not in wanted]
    return {m: i for i, m in enumerate(first + wanted)}, len(first)


COLUMN, ELIMINATED = monomials()


def from_action(
    action: np.ndarray, unknowns: list[int], basis: np.ndarray, scale_px: float, scale_mm: float
) -> list[np.ndarray]:
    """Similarities from an action matrix: its eigenvectors hold the null space's coefficients, the last of them 1."""
    if not np.isfinite(action).all():
        return []
    values, vectors = np.linalg.eig(action)
    out = []
    for value, vector in zip(values, vectors.T, strict=True):
        if value.imag < 0:
            continue
        a = basis @ (vector / vector[unknowns[-1]]).real[unknowns]
        a = a / a[-1]
        columns, translation = a[:-4].reshape(-1, 3).T, a[-4:-1]
        found = similarity(
            columns * scale_mm / scale_px, translation * scale_mm, planar=columns.shape[1] == 2
        )
        if found is not None:
            out.append(found)
    return out


def two_lines(points: np.ndarray, segments: np.ndarray) -> list[np.ndarray]:
    """2line3D: paper section 5.3, eq. (12)-(17), with the real part of complex solutions."""
    scale_px, scale_mm = np.abs(points).max(), np.abs(segments).max()
    rows = linear_rows(points / scale_px, segments / scale_mm, 3)
    basis = np.linalg.svd(rows)[2][7:].T  # (13, 6)
    c = [basis[3 * i : 3 * i + 3] for i in range(3)]
    r = [basis[[j, 3 + j, 6 + j]] for j in range(3)]
    system = np.zeros((50, len(COLUMN)))
    row = 0
    for vectors in (c, r):
        for i, j, k, m in QUADRICS:
            form = vectors[i].T @ vectors[j]
            if k is not None:
                form = form - vectors[k].T @ vectors[m]
            for factor in (5, 0, 1, 2, 3):
                for p in range(6):
                    for q in range(p, 6):
                        value = form[p, p] if p == q else form[p, q] + form[q, p]
                        system[row, COLUMN[tuple(sorted((p, q, factor)))]] += value
                row += 1
    upper = lu(system, permute_l=True)[1]
    corner = upper[ELIMINATED : ELIMINATED + 5, ELIMINATED:]
    try:
        reduced = -np.linalg.solve(corner[:, :5], corner[:, 5:])
    except np.linalg.LinAlgError:
        return []
    action = np.zeros((8, 8))
    action[:5] = reduced
    action[5, 0] = action[6, 1] = action[7, 5] = 1
    return from_action(action, [6, 5, 4, 3, 2, 7], basis, scale_px, scale_mm)


def four_points(points: np.ndarray, segments: np.ndarray) -> list[np.ndarray]:
    """4point2D: paper section 6.2, eq. (22)-(26)."""
    scale_px, scale_mm = np.abs(points).max(), np.abs(segments).max()
    basis = np.linalg.svd(linear_rows(points / scale_px, segments / scale_mm, 2))[2][7:].T  # (10, 3)
    c1, c2 = basis[:3], basis[3:6]
    columns = {
        (3, 0): 0,
        (2, 1): 1,
        (0, 3): 2,
        (2, 0): 3,
        (1, 2): 4,
        (0, 2): 5,
        (1, 1): 6,
        (0, 1): 7,
        (1, 0): 8,
    }
    columns[(0, 0)] = 9
    system = np.zeros((6, 10))
    for q, form in enumerate((c1.T @ c1 - c2.T @ c2, c1.T @ c2)):
        for f in range(3):
            for i in range(3):
                for j in range(3):
                    powers = [(1, 0), (0, 1), (0, 0)]
                    a, b = (sum(powers[k][n] for k in (i, j, f)) for n in (0, 1))
                    system[3 * q + f, columns[a, b]] += form[i, j]
    upper = lu(system, permute_l=True)[1]
    try:
        reduced = -np.linalg.solve(upper[4:, 4:6], upper[4:, 6:])
    except np.linalg.LinAlgError:
        return []
    action = np.vstack([reduced, [1, 0, 0, 0], [0, 1, 0, 0]])
    return from_action(action, [2, 1, 3], basis, scale_px, scale_mm)


def closed_form(points: np.ndarray, segments: np.ndarray) -> list[np.ndarray]:
    """Two lines on two lines: directions, common perpendiculars."""
    out = []
    a, b = (points[1] - points[0], points[3] - points[2])
    for sign in (1, -1):
        c, d = segments[0, 1] - segments[0, 0], sign * (segments[2, 1] - segments[2, 0])
        bases, feet, lengths = [], [], []
        for p, q, x, y in ((points[0], points[2], a, b), (segments[0, 0], segments[2, 0], c, d)):
            v, w = x / np.linalg.norm(x), y / np.linalg.norm(y)
            normal = np.cross(v, w)
            normal /= np.linalg.norm(normal)
            bisector = (v + w) / np.linalg.norm(v + w)
            steps = np.linalg.lstsq(np.column_stack([v, -w, normal]), q - p, rcond=None)[0]
            bases.append(np.column_stack([bisector, normal, np.cross(bisector, normal)]))
            feet.append((p + steps[0] * v + q + steps[1] * w) / 2)
            lengths.append(steps[2])
        scale = lengths[1] / lengths[0]
        if not scale > 0:
            continue
        for half_turn in (np.eye(3), np.diag([-1.0, 1, -1])):
            matrix = np.eye(4)
            rotation = bases[1] @ half_turn @ bases[0].T
            matrix[:3, :3], matrix[:3, 3] = scale * rotation, feet[1] - scale * rotation @ feet[0]
            out.append(matrix)
    return out


def refine(start: np.ndarray, cost: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
    scale = np.cbrt(np.linalg.det(start[:3, :3]))
    rotation = start[:3, :3] / scale

    def at(step: np.ndarray) -> np.ndarray:
        matrix = np.eye(4)
        matrix[:3, :3] = scale * np.exp(step[6]) * Rotation.from_rotvec(step[:3]).as_matrix() @ rotation
        matrix[:3, 3] = start[:3, 3] + step[3:6]
        return matrix

    return at(least_squares(lambda step: cost(at(step)), np.zeros(7), method="lm", x_scale="jac").x)


def point_to_line(points: np.ndarray, segments: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
    normals, on_line = planes_of(segments)

    def residuals(matrix: np.ndarray) -> np.ndarray:
        away = points @ matrix[:3, :3].T + matrix[:3, 3] - on_line
        return np.einsum("nki,ni->nk", normals, away).ravel()

    return residuals


def whitened(table: Table, near: np.ndarray) -> tuple[Callable[..., np.ndarray], Callable[..., np.ndarray]]:
    """Covariances of all residuals at a transform for unit levels, and white residuals for given levels."""
    points, segments, _, dimension = table
    normals, _ = planes_of(segments)
    along = segments[:, 1] - segments[:, 0]
    half = np.linalg.norm(along, axis=1) / 2
    mapped = points @ near[:3, :3].T + near[:3, 3]
    tau = np.sum((mapped - segments.mean(axis=1)) * along, axis=1) / (2 * half**2)
    count = len(points)
    pixel, ends = np.zeros((2, 2 * count, 2 * count))
    scale = near[:3, :dimension]
    for i in range(count):
        block = slice(2 * i, 2 * i + 2)
        pixel[block, block] = normals[i] @ scale @ scale.T @ normals[i].T
        mates = [i] if dimension == 2 else [i - i % 2, i - i % 2 + 1]
        for j in mates:
            ends[block, 2 * j : 2 * j + 2] = (1 + tau[i] * tau[j]) / 2 * np.eye(2)

    def covariance(levels: np.ndarray) -> np.ndarray:
        return np.exp(2 * levels[0]) * pixel + np.exp(2 * levels[1]) * ends

    residuals = point_to_line(points, segments)

    def white(matrix: np.ndarray, levels: np.ndarray) -> np.ndarray:
        return np.linalg.solve(np.linalg.cholesky(covariance(levels)), residuals(matrix))

    return covariance, white


def likelihood(table: Table, start: np.ndarray) -> np.ndarray:
    """Alternates restricted-likelihood noise levels with weighted refinement."""
    levels, matrix = np.zeros(2), start
    for _ in range(3):
        covariance, white = whitened(table, matrix)
        residual = point_to_line(table[0], table[1])
        base = residual(matrix)
        jacobian = numeric_jacobian(residual, matrix)

        def negative(log_levels: np.ndarray, base=base, jacobian=jacobian, covariance=covariance) -> float:
            factor = np.linalg.cholesky(covariance(log_levels))
            r, j = np.linalg.solve(factor, base), np.linalg.solve(factor, jacobian)
            information = j.T @ j
            fitted = r - j @ np.linalg.solve(information, j.T @ r)
            prior = (log_levels[0] - log_levels[1] + np.log(0.24)) ** 2 / 2
            return float(
                np.log(np.diag(factor)).sum()
                + np.linalg.slogdet(information)[1] / 2
                + fitted @ fitted / 2
                + prior
            )

        levels = minimize(negative, levels, method="BFGS").x
        matrix = refine(matrix, lambda m, white=white, levels=levels: white(m, levels))
    return matrix


def numeric_jacobian(residual: Callable[[np.ndarray], np.ndarray], matrix: np.ndarray) -> np.ndarray:
    scale = np.cbrt(np.linalg.det(matrix[:3, :3]))
    rotation, base, columns = matrix[:3, :3] / scale, residual(matrix), []
    for k in range(7):
        step = np.zeros(7)
        step[k] = 1e-6
        moved = np.eye(4)
        moved[:3, :3] = scale * np.exp(step[6]) * Rotation.from_rotvec(step[:3]).as_matrix() @ rotation
        moved[:3, 3] = matrix[:3, 3] + step[3:6]
        columns.append((residual(moved) - base) / 1e-6)
    return np.stack(columns, axis=1)


def solve_sample(method: str, table: Table, rows: np.ndarray) -> list[np.ndarray]:
    points, segments, dimension = table[0][rows], table[1][rows], table[3]
    if method in ("5point2D", "3line3D"):
        return linear(points, segments, dimension)
    if method == "2line3D":
        k = np.array([0, 0, np.abs(table[0]).max() if dimension == 2 else 0.0])
        found = two_lines(points + k, segments)
        for matrix in found:
            matrix[:3, 3] += matrix[:3, :3] @ k
        return found
    return four_points(points, segments) if dimension == 2 else closed_form(points, segments)


def sample_size(method: str, dimension: int) -> int:
    if method in ("5point2D", "3line3D"):
        return 5 if dimension == 2 else 3
    return 4 if dimension == 2 else 2


def run(
    method: str, table: Table, threshold_mm: float, seed: int
) -> tuple[np.ndarray | None, np.ndarray | None]:
    """One trial: RANSAC by truncated squared distances, then refinement on the rows that agree."""
    points, segments, sightings, dimension = table
    rng = np.random.default_rng(seed)
    units, size = sightings.max() + 1, sample_size(method, dimension)
    combinations = list(itertools.combinations(range(units), size))
    exhaustive = len(combinations) <= FEWEST_SAMPLES
    best, best_score, needed, tried = None, np.inf, MAX_SAMPLES, 0
    while tried < (len(combinations) if exhaustive else needed):
        chosen = combinations[tried] if exhaustive else rng.choice(units, size, replace=False)
        tried += 1
        rows = np.flatnonzero(np.isin(sightings, chosen))
        for matrix in solve_sample(method, table, rows):
            off = distances(matrix, points, segments)
            score = np.minimum(off**2, threshold_mm**2).sum()
            if score < best_score:
                best, best_score = matrix, score
                share = np.mean(off <= threshold_mm) ** size
                enough = (
                    np.log(1 - CONFIDENCE) / np.log1p(-share)
                    if 0 < share < 1
                    else (0 if share else MAX_SAMPLES)
                )
                needed = min(max(enough, FEWEST_SAMPLES), MAX_SAMPLES)
    if best is None:
        return None, None
    if method in ("5point2D", "3line3D"):
        agreeing = distances(best, points, segments) <= threshold_mm
        if agreeing.sum() >= (5 if dimension == 2 else 6):
            for matrix in linear(points[agreeing], segments[agreeing], dimension):
                score = np.minimum(distances(matrix, points, segments) ** 2, threshold_mm**2).sum()
                best = matrix if score < best_score else best
    refined, before = best, None
    for _ in range(20):
        off = distances(refined, points, segments)
        agreeing = off <= max(threshold_mm, np.sort(off)[3])
        if before is not None and np.array_equal(agreeing, before):
            break
        before = agreeing
        refined = refine(refined, point_to_line(points[agreeing], segments[agreeing]))
    if method == "sonocal":
        keep = np.ones(len(points), dtype=bool) if dimension == 3 else agreeing
        refined = likelihood((points[keep], segments[keep], sightings[keep], dimension), refined)
    return best, refined
