"""Compiled loops: admittance, its derivatives and the normal equations of a batch of parameter
vectors.

At each frequency K = Phi - M_xx is factorised once; R = K^-1 M_xv and L = M_yx K^-1 give both
Y = M_yv + M_yx R and dY = [L I] dM [R; I], so a derivative costs one outer product.
"""

from functools import cache

import numpy as np

from ibrid.fit.just_in_time import OPTIONS, njit
from ibrid.fit.lane_response import (
    MATRIX,
    answer_place,
    differentiate_in_lanes,
    lane_workspace,
    plan_elimination,
    respond_in_lanes,
)
from ibrid.fit.lanes import LANES, PARTS, WIDTH, dot_matrices, multiply

#: Stands for log(0): the model's entry is taken as 1e-12 of the measured one.
LOG_OF_NOTHING = -27.6 + 0.0j


@njit(**OPTIONS)
def _factorise(k, pivots, size):
    """LU with partial pivoting in place; False when singular."""
    for column in range(size):
        best, pivot = 0.0, column
        for row in range(column, size):
            value = k[row, column]
            magnitude = abs(value.real) + abs(value.imag)
            if magnitude > best:
                best, pivot = magnitude, row
        if not best > 0.0:
            return False
        pivots[column] = pivot
        if pivot != column:
            for j in range(size):
                k[column, j], k[pivot, j] = k[pivot, j], k[column, j]
        inverse = 1.0 / k[column, column]
        k[column, column] = inverse
        for row in range(column + 1, size):
            if k[row, column] != 0.0:
                factor = k[row, column] * inverse
                k[row, column] = factor
                for j in range(column + 1, size):
                    k[row, j] -= factor * k[column, j]
    return True


@njit(**OPTIONS)
def _solve_right(k, pivots, size, right):
    """right (size, 2) <- K^-1 right."""
    for i in range(size):
        pivot = pivots[i]
        if pivot != i:
            for c in range(2):
                right[i, c], right[pivot, c] = right[pivot, c], right[i, c]
    for i in range(size):
        for row in range(i + 1, size):
            factor = k[row, i]
            if factor != 0.0:
                right[row, 0] -= factor * right[i, 0]
                right[row, 1] -= factor * right[i, 1]
    for i in range(size - 1, -1, -1):
        right[i, 0] *= k[i, i]
        right[i, 1] *= k[i, i]
        for row in range(i):
            factor = k[row, i]
            if factor != 0.0:
                right[row, 0] -= factor * right[i, 0]
                right[row, 1] -= factor * right[i, 1]


@njit(**OPTIONS)
def _solve_left(k, pivots, size, left):
    """left (2, size) <- left K^-1, from the factors of K."""
    for i in range(size):
        left[0, i] *= k[i, i]
        left[1, i] *= k[i, i]
        for j in range(i + 1, size):
            factor = k[i, j]
            if factor != 0.0:
                left[0, j] -= left[0, i] * factor
                left[1, j] -= left[1, i] * factor
    for i in range(size - 1, -1, -1):
        for row in range(i + 1, size):
            factor = k[row, i]
            if factor != 0.0:
                left[0, i] -= left[0, row] * factor
                left[1, i] -= left[1, row] * factor
    for i in range(size - 1, -1, -1):
        pivot = pivots[i]
        if pivot != i:
            for c in range(2):
                left[c, i], left[c, pivot] = left[c, pivot], left[c, i]


@njit(**OPTIONS)
def _multiply(matrix, other):
    """matrix (n, 2) <- matrix other (2, 2)."""
    for i in range(matrix.shape[0]):
        first, second = matrix[i, 0], matrix[i, 1]
        matrix[i, 0] = first * other[0, 0] + second * other[1, 0]
        matrix[i, 1] = first * other[0, 1] + second * other[1, 1]


@njit(**OPTIONS)
def _workspace(size, entries, parameters):
    """Arrays that every frequency fills anew: K and its pivots, L, R, Y; the outer products of L
    and R at the entries of M, and dY (parameters, 4).
    """
    k = np.empty((size, size), dtype=np.complex128)
    pivots = np.empty(size, dtype=np.int64)
    left = np.empty((2, size + 2), dtype=np.complex128)
    right = np.empty((size + 2, 2), dtype=np.complex128)
    y = np.empty((2, 2), dtype=np.complex128)
    outer = np.empty((entries, 4), dtype=np.complex128)
    dy = np.empty((parameters, 4), dtype=np.complex128)
    return k, pivots, left, right, y, outer, dy


@njit(**OPTIONS)
def _respond(values, rows, columns, delays, s, excitation, derivative, workspace):
    """Y at one s into `y` (2, 2) of a workspace; with `derivative` also L (2, size + 2) and
    R (size + 2, 2). False when singular.

    excitation : (2, 2), by which Y and R are multiplied; of no size: by nothing.
    """
    k, pivots, left, right, y, _, _ = workspace
    size = pivots.size
    k[:, :] = 0.0
    right[:, :] = 0.0
    left[:, :] = 0.0
    y[:, :] = 0.0
    for index in range(rows.size):
        i, j, value = rows[index], columns[index], values[index]
        if i < size:
            if j < size:
                k[i, j] = -value
            else:
                right[i, j - size] = value
        elif j < size:
            left[i - size, j] = value
        else:
            y[i - size, j - size] = value
    for i in range(size):
        if delays[i] < 0.0:
            k[i, i] += s
        else:
            k[i, i] += np.exp(s * delays[i])
    output = left.copy()
    if not _factorise(k, pivots, size):
        return False
    _solve_right(k, pivots, size, right)
    for a in range(2):
        for b in range(2):
            for i in range(size):
                if output[a, i] != 0.0:
                    y[a, b] += output[a, i] * right[i, b]
    if derivative:
        _solve_left(k, pivots, size, left)
        for a in range(2):
            left[a, size + a] = 1.0
            right[size + a, a] = 1.0
    if excitation.size:
        _multiply(y, excitation)
        if derivative:
            _multiply(right, excitation)
    return True


def respond(values, rows, columns, delays, omega, size):
    """Admittance of one model.

    values : (nz,) entries of M at (rows, columns). delays : (size,) s, negative for a state. omega
    : (K,) rad/s. Returns (K, 2, 2) complex; not a number where the model has no response.
    """
    line = 1j * np.asarray(omega)
    return answer(values, rows, columns, delays, line, excited(None, line), size)


def admittance(model, theta, point, omega):
    """Admittance of a symbolic model at an operating point, with exact delays.

    model : `SymbolicModel`. theta : (P,) physical values of its parameters. point : (p, q, v) per
    unit. omega : (K,) rad/s. Returns (K, 2, 2) complex per unit, current out; not a number where
    the model has no response.
    """
    pattern = model.pattern
    theta = np.asarray(theta, dtype=float)
    values = np.array(model.values_only(theta, [*point])).ravel()
    return respond(
        values, pattern.rows, pattern.columns, pattern.delays(theta[None])[0], omega, pattern.size
    )


def excited(excitation, line):
    """What the loops below multiply an admittance by, read-only as they are compiled for: (K, 2, 2)
    complex; (K, 0, 0), which is nothing, for None.
    """
    given = (
        np.zeros((len(line), 0, 0), complex)
        if excitation is None
        else np.ascontiguousarray(excitation).view()
    )
    given.flags.writeable = False
    return given


@njit(**OPTIONS)
def answer(values, rows, columns, delays, s, excitation, size):
    """As `respond`, at s (K,) complex, rad/s, multiplied by what `excited` gives."""
    result = np.empty((s.size, 2, 2), dtype=np.complex128)
    workspace = _workspace(size, 0, 0)
    _, _, _, _, y, _, _ = workspace
    for index in range(s.size):
        if not _respond(
            values, rows, columns, delays, s[index], excitation[index], False, workspace
        ):
            y[:, :] = np.nan
        result[index] = y
    return result


@njit(**OPTIONS)
def _differentiate(
    derivatives, rows, columns, d_entry, d_parameter, delay_parameter, delays, s, workspace
):
    """The derivative of Y into `dy` of a workspace, from L and R."""
    _, pivots, left, right, _, outer, dy = workspace
    dy[:, :] = 0.0
    for index in range(rows.size):
        i, j = rows[index], columns[index]
        outer[index, 0] = left[0, i] * right[j, 0]
        outer[index, 1] = left[0, i] * right[j, 1]
        outer[index, 2] = left[1, i] * right[j, 0]
        outer[index, 3] = left[1, i] * right[j, 1]
    for index in range(d_entry.size):
        value, entry, parameter = derivatives[index], d_entry[index], d_parameter[index]
        for c in range(4):
            dy[parameter, c] += value * outer[entry, c]
    for i in range(pivots.size):
        if delay_parameter[i] >= 0:  # dK = s exp(s T) dT
            turn = -s * np.exp(s * delays[i])
            for a in range(2):
                for b in range(2):
                    dy[delay_parameter[i], 2 * a + b] += turn * left[a, i] * right[i, b]


@njit(**OPTIONS)
def respond_with_derivatives(
    values,
    derivatives,
    rows,
    columns,
    d_entry,
    d_parameter,
    delay_parameter,
    delays,
    s,
    excitation,
    size,
    parameters,
):
    """Answer (K, 2, 2) and its derivative (K, 2, 2, P) by the parameters of one model."""
    workspace = _workspace(size, rows.size, parameters)
    _, _, _, _, y, _, dy = workspace
    response = np.empty((s.size, 2, 2), dtype=np.complex128)
    slope = np.empty((s.size, 2, 2, parameters), dtype=np.complex128)
    for index in range(s.size):
        if not _respond(
            values, rows, columns, delays, s[index], excitation[index], True, workspace
        ):
            response[index], slope[index] = np.nan, np.nan
            continue
        _differentiate(
            derivatives,
            rows,
            columns,
            d_entry,
            d_parameter,
            delay_parameter,
            delays,
            s[index],
            workspace,
        )
        response[index] = y
        for a in range(2):
            for b in range(2):
                slope[index, a, b] = dy[:, 2 * a + b]
    return response, slope


@njit(**OPTIONS)
def _put_in_lanes(response, derivative, size, slopes_place, numbers):
    """Write answers (LANES, 2, 2) and derivatives (LANES, 2, 2, P) where a workspace of lanes has
    them.
    """
    for lane in range(LANES):
        for entry in range(4):
            a, b = entry // 2, entry % 2
            at = answer_place(entry, size) + lane
            numbers[at], numbers[at + LANES] = response[lane, a, b].real, response[lane, a, b].imag
            for p in range(derivative.shape[3]):
                at = slopes_place + p * MATRIX + entry * WIDTH + lane
                numbers[at] = derivative[lane, a, b, p].real
                numbers[at + LANES] = derivative[lane, a, b, p].imag


@njit(**OPTIONS)
def _residual(model, measured, weight, logarithmic):
    """weight (model - measured), or weight log(model / measured), and its slope by the model."""
    if not logarithmic:
        return weight * (model - measured), weight + 0.0j
    if weight == 0.0:
        return 0.0j, 0.0j
    if model == 0.0:  # an entry that the structure does not couple: far off, and no slope helps
        return weight * LOG_OF_NOTHING, 0.0j
    return weight * np.log(model / measured), weight / model


@njit(**OPTIONS)
def normal_equations(
    values,
    derivatives,
    rows,
    columns,
    d_entry,
    d_parameter,
    delay_parameter,
    delays,
    line,
    excitation,
    data,
    weight,
    logarithmic,
    size,
    parameters,
    with_gradient,
    most,
    with_slopes,
    plan,
):
    """Cost sum |r|^2, gradient J'r and Gauss-Newton matrix J'J of a batch at one operating point.

    r = weight (Y - data), or weight log(Y / data) with `logarithmic`. `LANES` frequencies are taken
    at once; where an excitation multiplies Y, or they cannot share pivots, one by one.

    values : (S, nz). derivatives : (S, nd). delays : (S, size). line : (K,) complex, rad/s. data,
    weight : (K, 2, 2).
    excitation : from `excited`; Y is multiplied by it. most : (S,), beyond which a cost is of no
    interest. plan : from `plan_elimination`.

    Returns costs (S,), gradients (S, P), matrices (S, P, P), r (S, N) and J (S, P, N) of all real
    and imaginary parts, in an order of their own that both share; J is of no use unless
    `with_slopes`. The cost is infinite where the model has no response, or it is of no interest.
    """
    batch, number = values.shape[0], line.size
    cost = np.zeros(batch)
    gradient = np.zeros((batch, parameters))
    hessian = np.zeros((batch, parameters, parameters))
    # the last frequency again, without weight, where a group is not full
    taken = np.minimum(np.arange(-(-number // LANES) * LANES), number - 1)
    s, excitations = line[taken], excitation[taken]
    residuals = np.zeros((batch, taken.size * PARTS))
    slopes = np.zeros((batch if with_slopes else 1, parameters, taken.size * PARTS))
    space = lane_workspace(size, parameters)
    numbers, places = space[0], space[1]
    _, _, _, slopes_place, residual_place, factor_place = places
    no_derivative = np.zeros((LANES, 2, 2, 0), dtype=np.complex128)
    for start in range(batch):
        total = 0.0
        for begin in range(0, number, LANES):
            group = slice(begin, begin + LANES)
            together = excitation.shape[1] == 0 and respond_in_lanes(
                values[start], rows, columns, delays[start], s[group], with_gradient, plan, space
            )
            if together and with_gradient:
                differentiate_in_lanes(
                    derivatives[start], rows, columns, d_parameter, delay_parameter, plan, space
                )
            if not together and with_gradient:
                response, derivative = respond_with_derivatives(
                    values[start],
                    derivatives[start],
                    rows,
                    columns,
                    d_entry,
                    d_parameter,
                    delay_parameter,
                    delays[start],
                    s[group],
                    excitations[group],
                    size,
                    parameters,
                )
                _put_in_lanes(response, derivative, size, slopes_place, numbers)
            elif not together:
                response = answer(
                    values[start], rows, columns, delays[start], s[group], excitations[group], size
                )
                _put_in_lanes(response, no_derivative, size, slopes_place, numbers)
            for entry in range(4):
                a, b = entry // 2, entry % 2
                answered = answer_place(entry, size)
                for lane in range(LANES):
                    index = begin + lane
                    r, factor = 0.0j, 0.0j
                    if index < number:
                        model = complex(numbers[answered + lane], numbers[answered + LANES + lane])
                        r, factor = _residual(
                            model, data[index, a, b], weight[index, a, b], logarithmic
                        )
                        total += r.real * r.real + r.imag * r.imag
                    at = entry * WIDTH + lane
                    numbers[residual_place + at] = r.real
                    numbers[residual_place + at + LANES] = r.imag
                    numbers[factor_place + at] = factor.real
                    numbers[factor_place + at + LANES] = factor.imag
            if not total <= most[start]:
                total = np.inf
                break
            own = slice(begin * PARTS, begin * PARTS + MATRIX)
            residuals[start, own] = numbers[residual_place : residual_place + MATRIX]
            for p in range(parameters):
                slope = slopes_place + p * MATRIX
                for place in range(0, MATRIX, WIDTH):
                    multiply(numbers, slope + place, slope + place, factor_place + place)
                gradient[start, p] += dot_matrices(numbers, slope, residual_place)
                for q in range(p + 1):
                    other = slopes_place + q * MATRIX
                    hessian[start, p, q] += dot_matrices(numbers, slope, other)
                if with_slopes:
                    slopes[start, p, own] = numbers[slope : slope + MATRIX]
        cost[start] = total if np.isfinite(total) else np.inf
        for p in range(parameters):
            for q in range(p):
                hessian[start, q, p] = hessian[start, p, q]
    return cost, gradient, hessian, residuals, slopes


@cache
def load() -> None:
    """Compile, or fetch from disk, once per process: about ten seconds the very first time, 0.2 s
    later.
    """
    values, derivatives = -np.ones((1, 1)), np.ones((1, 1))
    rows, none = np.zeros(1, dtype=np.int64), np.full(1, -1, dtype=np.int64)
    line = np.ones(1, dtype=complex)
    excitation = excited(None, line)
    delays, weight = -np.ones((1, 1)), np.ones((1, 2, 2))
    data = np.ones((1, 2, 2), dtype=complex)
    data.flags.writeable = False  # as measured data are
    for with_gradient in (False, True):
        normal_equations(
            values,
            derivatives,
            rows,
            rows,
            rows,
            rows,
            none,
            delays,
            line,
            excitation,
            data,
            weight,
            False,
            1,
            1,
            with_gradient,
            np.ones(1),
            False,
            plan_elimination(rows, rows, rows, 1),
        )
    answer(values[0], rows, rows, delays[0], line, excitation, 1)
    respond_with_derivatives(
        values[0], derivatives[0], rows, rows, rows, rows, none, delays[0], line, excitation, 1, 1
    )
